//! `rolling`: the actions with the most time steps on a carrying surface, which tell friction.
//!
//! Source: Semage et al., action grouping. Differences from the source: none known; ties keep their order.

use super::{Candidate, Strategy, ranked};

/// The strategy's row in the registry.
pub struct Rolling;

impl Strategy for Rolling {
    fn name(&self) -> &'static str {
        "rolling"
    }

    fn choose(&self, candidates: &[Candidate], n: usize) -> Vec<usize> {
        let mut order = ranked(candidates, |c| f64::from(c.rolling_steps));
        order.truncate(n);
        order
    }
}
