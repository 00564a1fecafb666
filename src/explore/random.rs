//! `random`: actions as they were drawn; the baseline.

use super::{Chosen, Situation, Strategy};
use crate::error::Result;

/// The strategy's row in the registry.
pub struct Random;

impl Strategy for Random {
    fn name(&self) -> &'static str {
        "random"
    }

    fn choose(&self, situation: &Situation, n: usize) -> Result<Chosen> {
        Chosen::free((0..situation.candidates.len()).collect(), n)
    }
}
