//! `collisions`: actions with the most collisions, which identify restitution.
//!
//! Source: Semage et al., action grouping. Differences from the source: a collision is a contact begin between
//! two objects that both carry the latent factors ([`super::informative_collisions`]): between balls in
//! bowling, as in the source, and of the ball with the plank in basketball, where only one body moves. Ties are
//! ordered by less time on surfaces, so that the group differs from `rolling` where possible.

use super::{AcquisitionContext, ActionCandidate, ActionSelection, Strategy, rank_by};
use crate::error::Result;

/// The strategy's row in the registry.
pub struct CollisionsStrategy;

impl Strategy for CollisionsStrategy {
    fn name(&self) -> &'static str {
        "collisions"
    }

    fn select(&self, situation: &AcquisitionContext, n: usize) -> Result<ActionSelection> {
        ActionSelection::first(rank(situation.candidates), n)
    }
}

/// All candidates, best first.
pub(super) fn rank(candidates: &[ActionCandidate]) -> Vec<usize> {
    rank_by(candidates, |c| f64::from(c.collisions) - 1e-9 * f64::from(c.rolling_steps))
}
