//! `mixed`: collisions and rolling in turn, so that no latent goes unseen.
//!
//! Source: Semage et al., action grouping. Differences from the source: the two rankings are interleaved one by
//! one, collisions first; an action that both want is taken once.

use super::{Chosen, Situation, Strategy, collisions, rolling};
use crate::error::Result;

/// The strategy's row in the registry.
pub struct Mixed;

impl Strategy for Mixed {
    fn name(&self) -> &'static str {
        "mixed"
    }

    fn choose(&self, situation: &Situation, n: usize) -> Result<Chosen> {
        let (first, second) = (collisions::order(situation.candidates), rolling::order(situation.candidates));
        let mut taken = vec![false; situation.candidates.len()];
        let turns = first.into_iter().zip(second).flat_map(|(a, b)| [a, b]);
        Chosen::free(turns.filter(|i| !std::mem::replace(&mut taken[*i], true)).collect(), n)
    }
}
