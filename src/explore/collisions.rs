//! `collisions`: the actions with the most collisions, which tell restitution.
//!
//! Source: Semage et al., action grouping. Differences from the source: a collision is a contact begun between two
//! things that both carry the latent factors ([`super::collisions_of`]): between balls in bowling, as in the source,
//! and of the ball with the plank in basketball, where a single body moves and nothing else could collide. Among
//! equal counts the shorter time on surfaces goes first, so that the group differs from `rolling` where it can.

use super::{Candidate, Chosen, Situation, Strategy, ranked};
use crate::error::Result;

/// The strategy's row in the registry.
pub struct Collisions;

impl Strategy for Collisions {
    fn name(&self) -> &'static str {
        "collisions"
    }

    fn choose(&self, situation: &Situation, n: usize) -> Result<Chosen> {
        Chosen::free(order(situation.candidates), n)
    }
}

/// All candidates, most wanted first.
pub(super) fn order(candidates: &[Candidate]) -> Vec<usize> {
    ranked(candidates, |c| f64::from(c.collisions) - 1e-9 * f64::from(c.rolling_steps))
}
