//! Rows of a study's table, and the verdicts on claims that follow from them.

use serde::{Deserialize, Serialize};

use super::statistics::{Claim, ClaimVerdict, Summary};
use crate::task::JumpStartClaim;

/// Results of one row after one round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StudyRow {
    pub name: String,
    pub round: Option<usize>,
    /// Mean real interactions before transfer.
    pub interactions: f64,
    /// AUCCESS before learning in the real world.
    pub jump_start: Summary,
    /// Mean jump start of each seed, in the order of the study's seeds.
    pub by_seed: Vec<f64>,
    /// (batches learned in the real world, AUCCESS), the jump start first.
    pub curve: Vec<(usize, Summary)>,
}

/// AUCCESS difference below which a claim is judged as small: less than the standard error of a policy over five folds of bowling.
pub const MIN_RELEVANT_AUCCESS_DIFFERENCE: f64 = 0.03;

/// Verdict on whether one row's jump start is better than another's; `None` if one of them is missing.
pub(super) fn jump_start_claim(claim: &JumpStartClaim, rows: &[StudyRow]) -> Option<Claim> {
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
        verdict: found.above_zero_by(MIN_RELEVANT_AUCCESS_DIFFERENCE),
    })
}

/// Verdicts on whether simulations extended from few trials come close to the true simulation, the row named `oracle`; the last round
/// of each row.
pub(super) fn oracle_claims(rows: &[StudyRow], oracle: &str) -> Vec<Claim> {
    let Some(oracle) = rows.iter().rfind(|r| r.name == oracle) else { return Vec::new() };
    let few = |r: &&StudyRow| r.name.starts_with("extended by") && r.interactions <= 50.0;
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
            verdict: if ratio >= 0.95 { ClaimVerdict::Reproduced } else { ClaimVerdict::NotReproduced },
        };
        claims.push((&row.name, claim));
    }
    claims.into_iter().map(|(_, claim)| claim).collect()
}
