//! A job's work and the context it runs in.

use std::collections::BTreeMap;

use serde_json::Value;

use super::record::Figure;
use crate::budget::Budget;
use crate::error::Result;
use crate::progress::Progress;

/// The work of a job.
pub type Work = Box<dyn FnOnce(&JobContext) -> Result<WorkOutcome> + Send>;

/// Builds a job's work from its plan; owns what the work needs.
pub type WorkFactory = Box<dyn Fn(&Value) -> Result<Work> + Send + Sync>;

/// Factories by kind of job.
pub type WorkFactories = BTreeMap<&'static str, WorkFactory>;

/// How work ends.
pub enum WorkOutcome {
    /// With a result.
    Done(Value),
    /// Not yet: it waits for [`Runner::report_results`](super::Runner::report_results).
    Waiting,
}

/// Context of running work: identity, progress and cancellation.
pub struct JobContext<'a> {
    /// The job's id.
    pub id: &'a str,
    /// Its number in the store.
    pub number: i64,
    /// Name of the token that queued it.
    pub owner: Option<&'a str>,
    pub(super) stage: &'a dyn JobReporter,
}

/// Receiver of the work's reports.
pub(super) trait JobReporter: Sync {
    /// An error once the work must stop.
    fn check_stop(&self) -> Result<()>;
    /// Progress of a stage; an error once the work must stop.
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()>;
    /// A partial result for the job's log.
    fn note(&self, text: &str);
    /// A warning for the job's log.
    fn warn(&self, text: &str);
    /// A figure, sent with the next event.
    fn figure(&self, figure: Figure);
    /// Number of finished rounds.
    fn round(&self, done: u64, total: u64);
}

impl Progress for JobContext<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.stage.report(stage, done, total)
    }

    fn check_stop(&self) -> Result<()> {
        self.stage.check_stop()
    }

    fn note(&self, text: &str) {
        self.stage.note(text);
    }

    fn metric(&self, name: &'static str, at: u64, value: f64) {
        self.stage.figure(Figure { name, at, value });
    }
}

impl Budget for JobContext<'_> {
    fn check(&self) -> Result<()> {
        self.stage.check_stop()
    }
}

impl JobContext<'_> {
    /// Writes a warning to the job's log.
    pub fn warn(&self, text: &str) {
        self.stage.warn(text);
    }

    /// For work with rounds of about equal cost: `done` of `total` are finished.
    pub fn round(&self, done: u64, total: u64) {
        self.stage.round(done, total);
    }
}
