//! Rounds of ask-tell estimations.

use super::estimation::{self, EstimationJob, RealitySource};
use crate::error::{Error, Result};
use crate::experiment::{PendingRound, Proposal};
use crate::job::Job;
use crate::json::from_value;
use crate::serve::request_context::RequestContext;
use crate::task::{Placement, Scene, Task};

/// The rounds of a job.
pub struct JobRounds {
    pub last: Option<LastRound>,
}

/// The last round of a job.
pub struct LastRound {
    pub number: u64,
    pub asked: PendingRound,
    /// Whether it is still to be fitted.
    pub open: bool,
}

impl JobRounds {
    /// Loads the rounds of a job by its number.
    pub fn of(app: &RequestContext, job: i64) -> Result<JobRounds> {
        let last = app.store().last_round(job)?;
        let last = last.map(|row| {
            Ok::<_, Error>(LastRound {
                number: row.number,
                asked: estimation::parse_pending_round(&row.asked)?,
                open: row.done.is_none(),
            })
        });
        Ok(JobRounds { last: last.transpose()? })
    }

    /// The proposal with this number, of this or an earlier round.
    pub fn find(&self, app: &RequestContext, job: i64, number: u64, field: &str) -> Result<Proposal> {
        let Some(last) = &self.last else {
            return Err(conflict("there are no proposals yet; list the proposals first"));
        };
        if number < last.first() {
            for row in app.store().rounds(job)? {
                let asked = estimation::parse_pending_round(&row.asked)?;
                if let Some(p) = asked.proposals.into_iter().find(|p| p.number == number) {
                    return Ok(p);
                }
            }
        }
        last.asked.proposals.iter().find(|p| p.number == number).cloned().ok_or_else(|| {
            let (first, end) = (last.first(), last.first() + last.asked.proposals.len() as u64);
            let allowed = format!("the number of a proposal: {first} to {} are open", end.saturating_sub(1));
            Error::input(field, number, allowed)
        })
    }
}

impl LastRound {
    /// Number of its first proposal.
    pub fn first(&self) -> u64 {
        self.asked.proposals.first().map_or(0, |p| p.number)
    }
}

/// The job, which must be an ask-tell estimation, and its tasks.
pub fn ask_tell_job(app: &RequestContext, id: &str) -> Result<(Job, Vec<Task>)> {
    let job = app.jobs().get(id)?;
    let plan = (job.row.kind == estimation::KIND)
        .then(|| from_value::<EstimationJob>(job.row.plan.clone()))
        .transpose()?;
    match plan {
        Some(plan) if plan.real == RealitySource::AskTell => {
            let tasks = plan.tasks(&app.catalogue)?;
            Ok((job, tasks.tasks.to_vec()))
        }
        _ => Err(conflict(format!(
            "{id} does not accept measurements; start an estimation with \"real\": \"ask_tell\""
        ))),
    }
}

/// The scene with a proposal's action placed.
pub fn placed_scene(tasks: &[Task], proposal: &Proposal) -> Result<Scene> {
    let task = tasks.iter().find(|t| t.id == proposal.task);
    let task = task.ok_or_else(|| Error::Failed(format!("the task {} no longer exists", proposal.task)))?;
    match task.place(&proposal.action_on(task)?) {
        Placement::Valid(scene) => Ok(*scene),
        Placement::Invalid(reason) => Err(Error::Failed(format!("a proposal cannot be placed: {reason}"))),
    }
}

/// Error for a request that the job's state does not allow.
pub fn conflict(reason: impl Into<String>) -> Error {
    Error::Refused { reason: reason.into() }
}
