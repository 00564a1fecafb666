//! Attempts that a job makes in a world and makes once: those in a real world are kept as they are made, in one
//! transaction with its counter, and found again by a job that is begun again.

use super::text::text;
use crate::budget::Endless;
use crate::error::Result;
use crate::json::parse;
use crate::serve::shared::Base;
use crate::session::{Kind, Tried, World};
use crate::store::Measured;
use crate::task::{Task, ValidAction};

/// The attempts of a job in a world.
pub struct Attempts<'a> {
    base: &'a Base,
    job: i64,
    world: &'a World,
    /// Id of the world.
    id: &'a str,
    /// What was made before.
    kept: Measured,
}

impl<'a> Attempts<'a> {
    /// With what the job has made already.
    pub fn new(base: &'a Base, job: i64, world: &'a World, id: &'a str) -> Result<Attempts<'a>> {
        Ok(Attempts { base, job, world, id, kept: base.store.measured(job, 0)? })
    }

    /// Whether each action solved the task; `None` for one that could not be placed. `number` tells the batches of
    /// a job apart.
    pub fn solved(&self, number: u64, task: &Task, actions: &[ValidAction]) -> Result<Vec<Option<bool>>> {
        if let Some(Some(text)) = self.kept.get(&number) {
            return parse(text);
        }
        let solved = |results: &[Tried]| -> Vec<Option<bool>> {
            results.iter().map(|r| r.as_ref().ok().map(|t| t.solved())).collect()
        };
        let keep = |results: &[Tried], interactions: u64| {
            let row = Measured::from([(number, Some(text(&solved(results))?))]);
            self.base.store.put_measured(self.job, &row, Some((self.id, interactions)), None)
        };
        let real = self.world.kind() == Kind::Real;
        let results = self.world.attempts(task, actions, real.then_some(&keep), &Endless)?;
        self.base.metrics.attempted(self.world.kind(), actions.len() as u64);
        Ok(solved(&results))
    }
}
