//! Rows of a study's table, and what they say of claims.

use serde::{Deserialize, Serialize};

use super::statistics::{Claim, Summary, Verdict};
use crate::task::Ahead;

/// A row's results at one round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub name: String,
    pub round: Option<usize>,
    /// Mean real interactions before transfer.
    pub interactions: f64,
    /// AUCCESS before learning in the real world.
    pub jump_start: Summary,
    /// Mean of the jump start of each seed, in the order of the study's seeds.
    pub by_seed: Vec<f64>,
    /// (batches learned in the real world, AUCCESS), the jump start first.
    pub curve: Vec<(usize, Summary)>,
}

/// AUCCESS within which a claim's difference is small: less than the standard error that five folds of bowling's tasks give a policy.
pub const SMALL_AUCCESS: f64 = 0.03;

/// Whether one row starts ahead of another; `None` where one of them is not there.
pub(super) fn ahead(claim: &Ahead, rows: &[Row]) -> Option<Claim> {
    let at = |name: &str| rows.iter().rfind(|r| r.name == name);
    let (better, worse) = (at(claim.better)?, at(claim.worse)?);
    let difference: Vec<f64> = better.by_seed.iter().zip(&worse.by_seed).map(|(b, w)| b - w).collect();
    let found = Summary::of(&difference);
    Some(Claim {
        text: claim.text.into(),
        figure: format!(
            "{:.3} against {:.3}; difference {} (95 % +- {:.3})",
            better.jump_start.mean,
            worse.jump_start.mean,
            found.show(3),
            found.half_width.unwrap_or(f64::INFINITY)
        ),
        verdict: found.above_zero_by(SMALL_AUCCESS),
    })
}

/// Whether simulations extended by what few trials tell come near the one that knows everything, the row named `oracle`; of each kind
/// the last round.
pub(super) fn near_the_oracle(rows: &[Row], oracle: &str) -> Vec<Claim> {
    let Some(oracle) = rows.iter().rfind(|r| r.name == oracle) else { return Vec::new() };
    let few = |r: &&Row| r.name.starts_with("extended by") && r.interactions <= 50.0;
    let mut claims: Vec<(&str, Claim)> = Vec::new();
    for row in rows.iter().rev().filter(few) {
        if claims.iter().any(|(name, _)| *name == row.name) {
            continue;
        }
        let ratio = row.jump_start.mean / oracle.jump_start.mean;
        let claim = Claim {
            text: format!(
                "past the paper: {} reaches 0.95 of the oracle with at most 50 interactions",
                row.name
            ),
            figure: format!(
                "{:.3} of {:.3}: {ratio:.3}, after {:.0} interactions",
                row.jump_start.mean, oracle.jump_start.mean, row.interactions
            ),
            verdict: if ratio >= 0.95 { Verdict::Reproduced } else { Verdict::NotReproduced },
        };
        claims.push((&row.name, claim));
    }
    claims.into_iter().map(|(_, claim)| claim).collect()
}
