//! How long work may go on: asked now and then by whoever works long, so that it can be stopped in the middle.

use crate::error::Result;

/// Says whether work may go on; an error it gives (usually `Error::Cancelled` or `Error::Deadline`) ends the work.
pub trait Budget: Sync {
    /// An error once the work is to end. Cheap: a simulation asks every millisecond or so.
    fn look(&self) -> Result<()>;
}

/// Items with a look at the budget every thousand of them: for work that takes a microsecond an item.
pub fn watched<I: IntoIterator>(items: I, budget: &dyn Budget) -> impl Iterator<Item = Result<I::Item>> {
    items
        .into_iter()
        .enumerate()
        .map(|(i, item)| if i.is_multiple_of(1000) { budget.look().map(|()| item) } else { Ok(item) })
}

/// Goes on for as long as it takes.
pub struct Endless;

impl Budget for Endless {
    fn look(&self) -> Result<()> {
        Ok(())
    }
}
