//! Progress reporters that prefix stage names.

use crate::error::Result;
use crate::progress::Progress;

/// Prefixes every stage with a name.
pub(super) struct PrefixedProgress<'a> {
    pub inner: &'a dyn Progress,
    pub name: String,
}

impl Progress for PrefixedProgress<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.inner.report(&format!("{}: {stage}", self.name), done, total)
    }
}

/// Prefixes every stage with the number of the round.
pub(super) struct RoundProgress<'a> {
    pub inner: &'a dyn Progress,
    pub round: usize,
    pub rounds: usize,
}

impl Progress for RoundProgress<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.inner.report(&format!("round {} of {}: {stage}", self.round + 1, self.rounds), done, total)
    }
}
