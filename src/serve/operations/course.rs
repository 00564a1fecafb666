//! The course of an estimation: what every round proposed and why, and what was known after it.

use serde::{Deserialize, Serialize};

use super::estimation;
use crate::error::{Error, Result};
use crate::estimate::LatentEstimate;
use crate::experiment::Round;
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

/// A finished round as it is kept.
#[derive(Serialize, Deserialize)]
pub struct Closed {
    #[serde(flatten)]
    pub round: Round,
    /// What was known after it; empty if nothing was measured, and in rounds of programs that did not keep it.
    #[serde(default)]
    pub known: Vec<LatentEstimate>,
}

fn rounds(app: &App, (Id(id), page): (Id, Page)) -> Result<Course> {
    let row = app.jobs().get(&id)?.row;
    if row.kind != estimation::KIND {
        return Err(Error::Refused { reason: format!("{id} is no estimation and has no rounds") });
    }
    let list = format!("rounds of {id}");
    let after: Option<u64> = page.after(&list)?;
    let (stored, measured) = (app.store().rounds(row.number)?, app.store().measured(row.number, 0)?);
    let (mut out, mut interactions) = (Vec::new(), 0);
    for stored in &stored {
        let round = read(stored, &measured, &mut interactions)?;
        if after.is_none_or(|n| round.number > n) && out.len() < page.fetch() {
            out.push(round);
        }
    }
    let next = page.cut(&list, &mut out, |r| r.number);
    Ok(Course { state: row.state.name(), interactions: count(&measured), rounds: out, next })
}

/// A round; `interactions` counts on over those before it.
fn read(row: &RoundRow, measured: &Measured, interactions: &mut u64) -> Result<RoundOut> {
    let asked = estimation::asked(&row.asked)?;
    let closed: Option<Closed> = row.done.as_deref().map(parse).transpose()?;
    let outcome = |number| measured.get(&number).map(Option::is_some);
    *interactions += asked.proposals.iter().filter(|p| outcome(p.number) == Some(true)).count() as u64;
    let (residual, known) = closed.map_or((None, Vec::new()), |c| (c.round.residual, c.known));
    Ok(RoundOut {
        number: row.number,
        fitted: row.done.is_some(),
        proposals: asked.proposals.into_iter().map(|p| (outcome(p.number), p).into()).collect(),
        choice: asked.choice.into(),
        interactions: *interactions,
        residual,
        latents: known.into_iter().map(Into::into).collect(),
    })
}

fn count(measured: &Measured) -> u64 {
    measured.values().filter(|outcome| outcome.is_some()).count() as u64
}
