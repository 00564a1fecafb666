//! The course of an estimation: what every round proposed and why, and what was known after it.

use super::closed::Closed;
use super::estimation;
use crate::error::{Error, Result};
use crate::experiment::Asked;
use crate::json::parse;
use crate::serve::app::App;
use crate::serve::operation::{Id, Operation, Page, READ, get};
use crate::serve::wire::{Course, RoundOut};
use crate::store::{Measured, RoundRow};

/// What can be asked of the course of an estimation.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_rounds", "/v1/iplw/{id}/rounds", "workflow", READ)
            .about(
                "The rounds of an estimation so far, the open one too: what was proposed and why, the residual, and what \
                 was known\nof each latent after it, with intervals.",
            )
            .refuses(&[(404, ""), (409, "The job is no estimation")])
            .does(rounds),
    ]
}

fn rounds(app: &App, (Id(id), page): (Id, Page)) -> Result<Course> {
    let row = app.jobs().get(&id)?.row;
    if row.kind != estimation::KIND {
        return Err(Error::Refused { reason: format!("{id} is no estimation and has no rounds") });
    }
    let list = format!("rounds of {id}");
    let after: Option<u64> = page.after(&list)?;
    let stored: Vec<Stored> =
        app.store().rounds(row.number)?.iter().map(Stored::read).collect::<Result<_>>()?;
    // Measurements are large, and finished rounds know which there are.
    let unsaid = stored.iter().find(|r| r.answered().is_none()).and_then(|r| r.asked.proposals.first());
    let measured = match unsaid {
        Some(first) => app.store().measured(row.number, first.number)?,
        None => Measured::new(),
    };
    let (mut out, mut interactions) = (Vec::new(), 0);
    for round in stored {
        let round = round.out(&measured, &mut interactions);
        if after.is_none_or(|n| round.number > n) && out.len() < page.fetch() {
            out.push(round);
        }
    }
    let next = page.cut(&list, &mut out, |r| r.number);
    Ok(Course { state: row.state.name(), interactions, rounds: out, next })
}

/// A round of the store.
struct Stored {
    number: u64,
    asked: Asked,
    closed: Option<Closed>,
}

impl Stored {
    fn read(row: &RoundRow) -> Result<Stored> {
        let closed = row.done.as_deref().map(parse).transpose()?;
        Ok(Stored { number: row.number, asked: estimation::asked(&row.asked)?, closed })
    }

    fn answered(&self) -> Option<&Vec<u64>> {
        self.closed.as_ref().and_then(|closed| closed.answered.as_ref())
    }

    /// As it is told; `interactions` counts on over those before it.
    fn out(self, measured: &Measured, interactions: &mut u64) -> RoundOut {
        let outcome = |number: u64| match self.answered() {
            Some(answered) => Some(answered.contains(&number)),
            None => measured.get(&number).map(Option::is_some),
        };
        let outcomes: Vec<Option<bool>> = self.asked.proposals.iter().map(|p| outcome(p.number)).collect();
        *interactions += outcomes.iter().filter(|o| **o == Some(true)).count() as u64;
        let fitted = self.closed.is_some();
        let (residual, known) = self.closed.map_or((None, Vec::new()), |c| (c.round.residual, c.known));
        RoundOut {
            number: self.number,
            fitted,
            proposals: outcomes.into_iter().zip(self.asked.proposals).map(Into::into).collect(),
            choice: self.asked.choice.into(),
            interactions: *interactions,
            residual,
            latents: known.into_iter().map(Into::into).collect(),
        }
    }
}
