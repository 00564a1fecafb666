//! `mixed`: alternates between collisions and rolling, so that both latents are covered.
//!
//! Source: Semage et al., action grouping. Differences from the source: the two rankings are interleaved one by
//! one, collisions first; an action in both is selected once.

use super::{AcquisitionContext, ActionSelection, Strategy, collisions, rolling};
use crate::error::Result;

/// The strategy's row in the registry.
pub struct MixedStrategy;

impl Strategy for MixedStrategy {
    fn name(&self) -> &'static str {
        "mixed"
    }

    fn select(&self, situation: &AcquisitionContext, n: usize) -> Result<ActionSelection> {
        let (first, second) = (collisions::rank(situation.candidates), rolling::rank(situation.candidates));
        let mut taken = vec![false; situation.candidates.len()];
        let turns = first.into_iter().zip(second).flat_map(|(a, b)| [a, b]);
        ActionSelection::first(turns.filter(|i| !std::mem::replace(&mut taken[*i], true)).collect(), n)
    }
}
