//! The rounds of an estimation that asks, as far as telling needs them.

use super::estimation::{self, Plan, Real};
use crate::error::{Error, Result};
use crate::experiment::{Asked, Proposal};
use crate::job::Job;
use crate::json::from_value;
use crate::serve::app::App;
use crate::task::{Placement, Scene, Task};

/// The rounds of a job.
pub struct Rounds {
    pub last: Option<Last>,
}

/// The last round there is.
pub struct Last {
    pub number: u64,
    pub asked: Asked,
    /// Whether it is not fitted yet.
    pub open: bool,
}

impl Rounds {
    /// Those of the job with this number.
    pub fn of(app: &App, job: i64) -> Result<Rounds> {
        let last = app.store().last_round(job)?;
        let last = last.map(|row| {
            Ok::<_, Error>(Last {
                number: row.number,
                asked: estimation::asked(&row.asked)?,
                open: row.done.is_none(),
            })
        });
        Ok(Rounds { last: last.transpose()? })
    }

    /// The proposal with this number, of this round or one before.
    pub fn find(&self, app: &App, job: i64, number: u64, field: &str) -> Result<Proposal> {
        let Some(last) = &self.last else {
            return Err(refuse("nothing is proposed yet; ask for proposals"));
        };
        if number < last.first() {
            for row in app.store().rounds(job)? {
                let asked = estimation::asked(&row.asked)?;
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

impl Last {
    /// Number of its first proposal.
    pub fn first(&self) -> u64 {
        self.asked.proposals.first().map_or(0, |p| p.number)
    }
}

/// The job, which must be one that asks, and its tasks.
pub fn asking(app: &App, id: &str) -> Result<(Job, Vec<Task>)> {
    let job = app.jobs().get(id)?;
    let plan =
        (job.row.kind == estimation::KIND).then(|| from_value::<Plan>(job.row.plan.clone())).transpose()?;
    match plan {
        Some(plan) if plan.real == Real::Asked => {
            let tasks = app.catalogue.named(&plan.task)?;
            Ok((job, tasks.tasks.to_vec()))
        }
        _ => {
            Err(refuse(format!("{id} does not ask for measurements; start one with \"real\": \"ask_tell\"")))
        }
    }
}

/// The scene in which a proposal is carried out.
pub fn placed(tasks: &[Task], proposal: &Proposal) -> Result<Scene> {
    let task = tasks.iter().find(|t| t.id == proposal.task);
    let task = task.ok_or_else(|| Error::Failed(format!("there is no task {} any more", proposal.task)))?;
    match task.place(&proposal.action_on(task)?) {
        Placement::Valid(scene) => Ok(*scene),
        Placement::Invalid(reason) => Err(Error::Failed(format!("a proposal cannot be placed: {reason}"))),
    }
}

/// The job is not in the state for it.
pub fn refuse(reason: impl Into<String>) -> Error {
    Error::Refused { reason: reason.into() }
}
