//! `collisions`: the actions with the most contacts begun between movable bodies, which tell restitution.
//!
//! Source: Semage et al., action grouping. Differences from the source: among equal counts the shorter time on
//! surfaces goes first, so that the group differs from `rolling` where it can (and in scenes with a single
//! movable body, where nothing collides, it means the actions that touch surfaces least).

use super::{Candidate, Strategy, ranked};

/// The strategy's row in the registry.
pub struct Collisions;

impl Strategy for Collisions {
    fn name(&self) -> &'static str {
        "collisions"
    }

    fn choose(&self, candidates: &[Candidate], n: usize) -> Vec<usize> {
        let mut order = ranked(candidates, |c| f64::from(c.collisions) - 1e-9 * f64::from(c.rolling_steps));
        order.truncate(n);
        order
    }
}
