//! What a job does, and what it sees of its job meanwhile.

use std::collections::BTreeMap;

use serde_json::Value;

use super::record::Figure;
use crate::budget::Budget;
use crate::error::Result;
use crate::progress::Progress;

/// What a job does.
pub type Work = Box<dyn FnOnce(&Context) -> Result<Outcome> + Send>;

/// Makes a job's work from its plan; holds on to what the work needs.
pub type Recipe = Box<dyn Fn(&Value) -> Result<Work> + Send + Sync>;

/// Recipes by kind of job.
pub type Recipes = BTreeMap<&'static str, Recipe>;

/// How work ends.
pub enum Outcome {
    /// With a result.
    Done(Value),
    /// Not yet: it waits for [`Runner::answered`].
    Waiting,
}

/// What work sees of its job, and reports to.
pub struct Context<'a> {
    /// The job's id.
    pub id: &'a str,
    /// Its number in the store.
    pub number: i64,
    /// Name of the token it was queued with.
    pub owner: Option<&'a str>,
    pub(super) stage: &'a dyn Stage,
}

/// Where what work reports goes.
pub(super) trait Stage: Sync {
    /// An error once it is to stop.
    fn look(&self) -> Result<()>;
    /// How far it is; an error once it is to stop.
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()>;
    /// Something that its owner should know.
    fn warn(&self, text: &str);
    /// A figure, told with the next event.
    fn figure(&self, figure: Figure);
    /// How many of its rounds are finished.
    fn round(&self, done: u64, total: u64);
}

impl Progress for Context<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.stage.report(stage, done, total)
    }

    fn figure(&self, name: &'static str, at: u64, value: f64) {
        self.stage.figure(Figure { name, at, value });
    }
}

impl Budget for Context<'_> {
    fn look(&self) -> Result<()> {
        self.stage.look()
    }
}

impl Context<'_> {
    /// Something that the job's owner should know though it goes on: a line of its log.
    pub fn warn(&self, text: &str) {
        self.stage.warn(text);
    }

    /// For work that goes in rounds of about the same cost: `done` of `total` are finished.
    pub fn round(&self, done: u64, total: u64) {
        self.stage.round(done, total);
    }
}
