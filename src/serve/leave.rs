//! How long a request may go on: to its deadline, and as long as somebody waits for its answer.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::budget::Budget;
use crate::error::{Error, Result};

/// A request's leave to go on.
pub struct Leave {
    deadline: Instant,
    /// From when it came to its deadline.
    span: Duration,
    gone: AtomicBool,
}

/// Says when dropped that nobody waits any more, unless it was told that the answer is there.
pub struct Waiting(Option<Arc<Leave>>);

impl Leave {
    /// From now on.
    pub fn of(span: Duration) -> Arc<Leave> {
        Arc::new(Leave { deadline: Instant::now() + span, span, gone: AtomicBool::new(false) })
    }

    /// Nobody waits for the answer any more.
    pub fn end(&self) {
        self.gone.store(true, Ordering::SeqCst);
    }

    /// When it ends.
    pub fn deadline(&self) -> Instant {
        self.deadline
    }

    /// That it has ended by its deadline.
    pub fn over(&self) -> Error {
        Error::Deadline { seconds: self.span.as_secs_f64() }
    }

    /// Ends it when what is given back is dropped without [`Waiting::answered`].
    pub fn waiting(self: &Arc<Leave>) -> Waiting {
        Waiting(Some(self.clone()))
    }
}

impl Budget for Leave {
    fn look(&self) -> Result<()> {
        if self.gone.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        if Instant::now() >= self.deadline { Err(self.over()) } else { Ok(()) }
    }
}

impl Waiting {
    /// There is an answer: nothing is left to end.
    pub fn answered(mut self) {
        self.0 = None;
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        if let Some(leave) = &self.0 {
            leave.end();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_ends_at_its_deadline_or_when_nobody_waits() {
        let leave = Leave::of(Duration::from_secs(60));
        leave.waiting().answered();
        assert!(leave.look().is_ok());
        drop(leave.waiting());
        assert_eq!(leave.look(), Err(Error::Cancelled));
        assert_eq!(Leave::of(Duration::ZERO).look(), Err(Error::Deadline { seconds: 0.0 }));
    }
}
