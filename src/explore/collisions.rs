//! `collisions`: the actions with the most contacts begun between movable bodies, which tell restitution.
//!
//! Source: Semage et al., action grouping. Differences from the source: among equal counts the shorter time on
//! surfaces goes first, so that the group differs from `rolling` where it can (and in scenes with a single
//! movable body, where nothing collides, it means the actions that touch surfaces least).

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
