//! Rollouts of jobs, each made once: results from a real world are stored in one transaction with its counter, and a restarted
//! job reuses them.

use super::json::to_json;
use crate::budget::{Budget, Unlimited};
use crate::error::{Error, Result};
use crate::job::JobContext;
use crate::json::parse;
use crate::serve::state::CoreState;
use crate::session::{AttemptResult, BODY_STEPS_LABEL, World, WorldKind};
use crate::store::MeasuredOutcomes;
use crate::task::{Task, ValidAction};

/// Adds to a work-limit error the advice to use a job instead.
pub fn suggest_job(error: Error) -> Error {
    match error {
        Error::TooLarge { what: BODY_STEPS_LABEL, asked, limit, .. } => {
            let advice = "take fewer actions, steps or bodies, or evaluate the actions in a job, which has no such limit: \
                 POST /v1/policies/ranked/evaluate (`evaluate_policy`) with the world and a `ranking`";
            Error::TooLarge { what: BODY_STEPS_LABEL, asked, limit, advice }
        }
        // An entry of a batch.
        Error::Entry { field, error } => Error::Entry { field, error: Box::new(suggest_job(*error)) },
        other => other,
    }
}

/// The rollouts of a job in a world.
pub struct PersistedRollouts<'a> {
    base: &'a CoreState,
    job: i64,
    world: &'a World,
    /// Id of the world.
    id: &'a str,
    /// Stored results of an interrupted run of the job.
    kept: MeasuredOutcomes,
    budget: &'a dyn Budget,
}

impl<'a> PersistedRollouts<'a> {
    /// Loads the results that the job has already stored.
    pub fn new(
        base: &'a CoreState,
        context: &'a JobContext<'a>,
        world: &'a World,
        id: &'a str,
    ) -> Result<PersistedRollouts<'a>> {
        let job = context.number;
        Ok(PersistedRollouts { base, job, world, id, kept: base.store.measured(job, 0)?, budget: context })
    }

    /// Whether each action solved the task; `None` if it could not be placed. `number` identifies the batch within the job.
    pub fn solved(&self, number: u64, task: &Task, actions: &[ValidAction]) -> Result<Vec<Option<bool>>> {
        if let Some(Some(text)) = self.kept.get(&number) {
            return parse(text);
        }
        let solved = |results: &[AttemptResult]| -> Vec<Option<bool>> {
            results.iter().map(|r| r.as_ref().ok().map(|t| t.solved())).collect()
        };
        let keep = |results: &[AttemptResult], interactions: u64| {
            let row = MeasuredOutcomes::from([(number, Some(to_json(&solved(results))?))]);
            self.base.store.put_measured(self.job, &row, Some((self.id, interactions)), None)
        };
        let real = self.world.kind() == WorldKind::Real;
        // Real interactions count once started, so they are completed and stored even if the job is cancelled.
        let budget = if real { &Unlimited } else { self.budget };
        let results = self.world.attempts(task, actions, real.then_some(&keep), budget)?;
        let steps = results.iter().flatten().map(|t| u64::from(t.outcome.steps)).sum();
        self.base.metrics.count_attempts(self.world.kind(), actions.len() as u64, steps);
        Ok(solved(&results))
    }
}
