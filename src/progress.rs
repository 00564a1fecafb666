//! Progress reports of long computations, which also allow to cancel them.

use crate::budget::Budget;
use crate::error::Result;

/// Receives progress; an error that it returns (usually `Error::Cancelled`) ends the computation.
pub trait Progress: Sync {
    /// `done` of `total` units of `stage` are finished.
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()>;

    /// An error once the computation must end. Cheap: it is called every few milliseconds, between reports.
    fn check_stop(&self) -> Result<()> {
        Ok(())
    }

    /// Logs a partial result, as a phrase for people.
    fn note(&self, _text: &str) {}

    /// Logs a metric: `name` was `value` after `at` units of the stage. Delivered with the next report.
    fn metric(&self, _name: &'static str, _at: u64, _value: f64) {}
}

/// As the budget of a simulation.
impl Budget for &dyn Progress {
    fn check(&self) -> Result<()> {
        self.check_stop()
    }
}

/// A budget as a progress without reports.
pub struct Unreported<'a>(pub &'a dyn Budget);

impl Progress for Unreported<'_> {
    fn report(&self, _stage: &str, _done: u64, _total: u64) -> Result<()> {
        self.0.check()
    }

    fn check_stop(&self) -> Result<()> {
        self.0.check()
    }
}

/// Ignores progress and never cancels.
pub struct NoProgress;

impl Progress for NoProgress {
    fn report(&self, _stage: &str, _done: u64, _total: u64) -> Result<()> {
        Ok(())
    }
}
