//! `rolling`: actions with the most time steps on a surface that carries the latents, which identify friction.
//!
//! Source: Semage et al., action grouping. Differences from the source: none known; ties keep their order.

use super::{AcquisitionContext, ActionCandidate, ActionSelection, Strategy, rank_by};
use crate::error::Result;

/// The strategy's row in the registry.
pub struct RollingStrategy;

impl Strategy for RollingStrategy {
    fn name(&self) -> &'static str {
        "rolling"
    }

    fn select(&self, situation: &AcquisitionContext, n: usize) -> Result<ActionSelection> {
        ActionSelection::first(rank(situation.candidates), n)
    }
}

/// All candidates, best first.
pub(super) fn rank(candidates: &[ActionCandidate]) -> Vec<usize> {
    rank_by(candidates, |c| f64::from(c.rolling_steps))
}
