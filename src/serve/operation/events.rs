//! Server-sent events of a job or a world.

use std::future::Future;
use std::pin::Pin;

/// One serialised event.
pub struct ServerEvent {
    /// Id to resume from; none for the initial snapshot.
    pub id: Option<u64>,
    pub name: &'static str,
    /// JSON
    pub data: String,
}

/// The next event; `None` after the last.
pub type NextEvent<'a> = Pin<Box<dyn Future<Output = Option<ServerEvent>> + Send + 'a>>;

/// A source of events.
pub trait EventStream: Send {
    /// Waits for the next event.
    fn next(&mut self) -> NextEvent<'_>;
    /// Whether a final event follows when the server stops.
    fn has_last_word(&self) -> bool;
}
