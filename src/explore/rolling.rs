//! `rolling`: the actions with the most time steps on a carrying surface, which tell friction.
//!
//! Source: Semage et al., action grouping. Differences from the source: none known; ties keep their order.

use super::{Candidate, Chosen, Situation, Strategy, ranked};
use crate::error::Result;

/// The strategy's row in the registry.
pub struct Rolling;

impl Strategy for Rolling {
    fn name(&self) -> &'static str {
        "rolling"
    }

    fn choose(&self, situation: &Situation, n: usize) -> Result<Chosen> {
        Chosen::free(order(situation.candidates), n)
    }
}

/// All candidates, most wanted first.
pub(super) fn order(candidates: &[Candidate]) -> Vec<usize> {
    ranked(candidates, |c| f64::from(c.rolling_steps))
}
