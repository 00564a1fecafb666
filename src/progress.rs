//! How long work tells where it is, and learns that it should stop.

use crate::error::Result;

/// Receives progress; an error it returns (usually `Error::Cancelled`) ends the work.
pub trait Progress: Sync {
    /// `done` of `total` units of `stage` are finished.
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()>;

    /// A figure to follow: `name` was `value` when `at` units of the stage were done. Told with the next report.
    fn figure(&self, _name: &'static str, _at: u64, _value: f64) {}
}

/// Ignores progress and never cancels.
pub struct Silent;

impl Progress for Silent {
    fn report(&self, _stage: &str, _done: u64, _total: u64) -> Result<()> {
        Ok(())
    }
}
