//! `random`: candidates in random order; the baseline.

use super::{AcquisitionContext, ActionSelection, Strategy};
use crate::error::Result;

/// The strategy's row in the registry.
pub struct RandomStrategy;

impl Strategy for RandomStrategy {
    fn name(&self) -> &'static str {
        "random"
    }

    fn select(&self, situation: &AcquisitionContext, n: usize) -> Result<ActionSelection> {
        ActionSelection::first((0..situation.candidates.len()).collect(), n)
    }
}
