//! Attempts that a job makes in a world and makes once: those in a real world are kept as they are made, in one
//! transaction with its counter, and found again by a job that is begun again.

use super::text::text;
use crate::budget::{Budget, Endless};
use crate::error::{Error, Result};
use crate::job::Context;
use crate::json::parse;
use crate::serve::shared::Base;
use crate::session::{Kind, Tried, WORK, World};
use crate::store::Measured;
use crate::task::{Task, ValidAction};

/// Says of work that is too much for a request that it may be done as a job.
pub fn or_as_a_job(error: Error) -> Error {
    match error {
        Error::TooLarge { what: WORK, asked, limit, .. } => {
            let advice = "take fewer actions, steps or bodies, or have the actions tried in a job, which has no such limit: \
                 POST /v1/policies/ranked/evaluate (`evaluate_policy`) with the world and a `ranking`";
            Error::TooLarge { what: WORK, asked, limit, advice }
        }
        // The entry of a batch.
        Error::Entry { field, error } => Error::Entry { field, error: Box::new(or_as_a_job(*error)) },
        other => other,
    }
}

/// The attempts of a job in a world.
pub struct Attempts<'a> {
    base: &'a Base,
    job: i64,
    world: &'a World,
    /// Id of the world.
    id: &'a str,
    /// What was made before.
    kept: Measured,
    budget: &'a dyn Budget,
}

impl<'a> Attempts<'a> {
    /// With what the job has made already.
    pub fn new(
        base: &'a Base,
        context: &'a Context<'a>,
        world: &'a World,
        id: &'a str,
    ) -> Result<Attempts<'a>> {
        let job = context.number;
        Ok(Attempts { base, job, world, id, kept: base.store.measured(job, 0)?, budget: context })
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
        // What is begun in a real world counts: it is ended, so that it can be kept.
        let budget = if real { &Endless } else { self.budget };
        let results = self.world.attempts(task, actions, real.then_some(&keep), budget)?;
        let steps = results.iter().flatten().map(|t| u64::from(t.outcome.steps)).sum();
        self.base.metrics.attempted(self.world.kind(), actions.len() as u64, steps);
        Ok(solved(&results))
    }
}
