//! History of an estimation: proposals and estimates per round.

use super::estimation;
use super::finished_round::FinishedRound;
use crate::error::{Error, Result};
use crate::experiment::PendingRound;
use crate::json::parse;
use crate::serve::operation::{Operation, Pagination, PathId, READ, get};
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{EstimationHistory, RoundOut};
use crate::store::{MeasuredOutcomes, RoundRow};

/// Operations on the history of an estimation.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_rounds", "/v1/iplw/{id}/rounds", "workflow", READ)
            .about(
                "Lists the rounds of an estimation, including the open one: proposals with reasons, the residual, and the \
                 estimate of\neach latent with its interval.",
            )
            .errors(&[(404, ""), (409, "The job is not an estimation")])
            .handler(rounds),
    ]
}

fn rounds(app: &RequestContext, (PathId(id), page): (PathId, Pagination)) -> Result<EstimationHistory> {
    let row = app.jobs().get(&id)?.row;
    if row.kind != estimation::KIND {
        return Err(Error::Refused { reason: format!("{id} is not an estimation, so it has no rounds") });
    }
    let list = format!("rounds of {id}");
    let after: Option<u64> = page.after(&list)?;
    let stored: Vec<StoredRound> =
        app.store().rounds(row.number)?.iter().map(StoredRound::read).collect::<Result<_>>()?;
    // Load measurements, which are large, only for rounds that do not list their measured proposals.
    let unsaid = stored.iter().find(|r| r.answered().is_none()).and_then(|r| r.asked.proposals.first());
    let measured = match unsaid {
        Some(first) => app.store().measured(row.number, first.number)?,
        None => MeasuredOutcomes::new(),
    };
    let (mut out, mut interactions) = (Vec::new(), 0);
    for round in stored {
        let round = round.out(&measured, &mut interactions);
        if after.is_none_or(|n| round.number > n) && out.len() < page.fetch_limit() {
            out.push(round);
        }
    }
    let next = page.truncate(&list, &mut out, |r| r.number);
    Ok(EstimationHistory { state: row.state.name(), interactions, rounds: out, next })
}

/// A round as loaded from the store.
struct StoredRound {
    number: u64,
    asked: PendingRound,
    closed: Option<FinishedRound>,
}

impl StoredRound {
    fn read(row: &RoundRow) -> Result<StoredRound> {
        let closed = row.done.as_deref().map(parse).transpose()?;
        Ok(StoredRound { number: row.number, asked: estimation::parse_pending_round(&row.asked)?, closed })
    }

    fn answered(&self) -> Option<&Vec<u64>> {
        self.closed.as_ref().and_then(|closed| closed.answered.as_ref())
    }

    /// Converts the round; `interactions` accumulates over the rounds.
    fn out(self, measured: &MeasuredOutcomes, interactions: &mut u64) -> RoundOut {
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
            latents: known,
        }
    }
}
