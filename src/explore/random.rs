//! `random`: actions as they were drawn; the baseline.

use super::{Candidate, Strategy};

/// The strategy's row in the registry.
pub struct Random;

impl Strategy for Random {
    fn name(&self) -> &'static str {
        "random"
    }

    fn choose(&self, candidates: &[Candidate], n: usize) -> Vec<usize> {
        (0..candidates.len().min(n)).collect()
    }
}
