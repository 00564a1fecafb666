//! How long work tells where it is, and learns that it should stop.

use crate::error::Result;

/// Receives progress; an error it returns (usually `Error::Cancelled`) ends the work.
pub trait Progress: Sync {
    /// `done` of `total` units of `stage` are finished.
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()>;
}

/// Ignores progress and never cancels.
pub struct Silent;

impl Progress for Silent {
    fn report(&self, _stage: &str, _done: u64, _total: u64) -> Result<()> {
        Ok(())
    }
}
