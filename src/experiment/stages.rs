//! Names put before the stages that work reports.

use crate::error::Result;
use crate::progress::Progress;

/// Puts a name before every stage.
pub(super) struct Named<'a> {
    pub inner: &'a dyn Progress,
    pub name: String,
}

impl Progress for Named<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.inner.report(&format!("{}: {stage}", self.name), done, total)
    }
}

/// Adds the round to the stage's name.
pub(super) struct Staged<'a> {
    pub inner: &'a dyn Progress,
    pub round: usize,
    pub rounds: usize,
}

impl Progress for Staged<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.inner.report(&format!("round {} of {}: {stage}", self.round + 1, self.rounds), done, total)
    }
}
