//! `mixed`: collisions and rolling in turn, so that no latent goes unseen.
//!
//! Source: Semage et al., action grouping. Differences from the source: the two rankings are interleaved one by
//! one, collisions first; an action that both want is taken once.

use super::collisions::Collisions;
use super::rolling::Rolling;
use super::{Candidate, Strategy};

/// The strategy's row in the registry.
pub struct Mixed;

impl Strategy for Mixed {
    fn name(&self) -> &'static str {
        "mixed"
    }

    fn choose(&self, candidates: &[Candidate], n: usize) -> Vec<usize> {
        let all = candidates.len();
        let (first, second) = (Collisions.choose(candidates, all), Rolling.choose(candidates, all));
        let mut taken = vec![false; all];
        let mut chosen = Vec::with_capacity(n.min(all));
        for index in first.into_iter().zip(second).flat_map(|(a, b)| [a, b]) {
            if chosen.len() < n && !std::mem::replace(&mut taken[index], true) {
                chosen.push(index);
            }
        }
        chosen
    }
}
