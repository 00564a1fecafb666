//! A progress reporter that prefixes stage names.

use crate::error::Result;
use crate::progress::Progress;

/// Prefixes every stage with a name.
pub(super) struct PrefixedProgress<'a> {
    pub inner: &'a dyn Progress,
    pub name: String,
}

impl<'a> PrefixedProgress<'a> {
    /// Prefixes every stage with the number of the round, counted from 0.
    pub fn round(inner: &'a dyn Progress, round: usize, rounds: usize) -> PrefixedProgress<'a> {
        PrefixedProgress { inner, name: format!("round {} of {rounds}", round + 1) }
    }
}

impl Progress for PrefixedProgress<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.inner.report(&format!("{}: {stage}", self.name), done, total)
    }

    fn check_stop(&self) -> Result<()> {
        self.inner.check_stop()
    }
}
