//! Events that come by and by: of a job, of a world.

use std::future::Future;
use std::pin::Pin;

/// One event, written.
pub struct Told {
    /// So that it can be gone on from; none for one that everybody is told first.
    pub id: Option<u64>,
    pub name: &'static str,
    /// JSON
    pub data: String,
}

/// The next event, once it is there; `None` after the last.
pub type Next<'a> = Pin<Box<dyn Future<Output = Option<Told>> + Send + 'a>>;

/// Where events come from.
pub trait Events: Send {
    /// Waits for the next event.
    fn next(&mut self) -> Next<'_>;
    /// Whether there is more to be told when the server stops.
    fn has_last_word(&self) -> bool;
}
