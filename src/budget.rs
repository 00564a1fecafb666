//! Budgets for long computations, which check them regularly so that they can be cancelled.

use crate::error::Result;

/// Decides whether a computation may continue; its error (usually `Error::Cancelled` or `Error::Deadline`)
/// ends it.
pub trait Budget: Sync {
    /// An error once the computation must end. Cheap: a simulation calls it every millisecond or so.
    fn check(&self) -> Result<()>;
}

/// The items, with a check of the budget every thousand of them: for work of about a microsecond per item.
pub fn checked<I: IntoIterator>(items: I, budget: &dyn Budget) -> impl Iterator<Item = Result<I::Item>> {
    items
        .into_iter()
        .enumerate()
        .map(|(i, item)| if i.is_multiple_of(1000) { budget.check().map(|()| item) } else { Ok(item) })
}

/// A budget without limit.
pub struct Unlimited;

impl Budget for Unlimited {
    fn check(&self) -> Result<()> {
        Ok(())
    }
}
