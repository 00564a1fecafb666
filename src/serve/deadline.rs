//! A request's deadline, and its cancellation when the client no longer waits.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::budget::Budget;
use crate::error::{Error, Result};

/// Deadline and cancellation flag of a request.
pub struct RequestDeadline {
    deadline: Instant,
    /// Time from the request's arrival to its deadline.
    timeout: Duration,
    cancelled: AtomicBool,
}

/// Cancels the request when dropped, unless disarmed.
pub struct CancelOnDrop(Option<Arc<RequestDeadline>>);

impl RequestDeadline {
    /// A deadline this long from now.
    pub fn after(timeout: Duration) -> Arc<RequestDeadline> {
        Arc::new(RequestDeadline {
            deadline: Instant::now() + timeout,
            timeout,
            cancelled: AtomicBool::new(false),
        })
    }

    /// Cancels the request.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::SeqCst);
    }

    /// The instant of the deadline.
    pub fn instant(&self) -> Instant {
        self.deadline
    }

    /// The error of a request that exceeded its deadline.
    pub fn exceeded(&self) -> Error {
        Error::Deadline { seconds: self.timeout.as_secs_f64() }
    }

    /// A guard that cancels the request when dropped without [`CancelOnDrop::disarm`].
    pub fn cancel_on_drop(self: &Arc<RequestDeadline>) -> CancelOnDrop {
        CancelOnDrop(Some(self.clone()))
    }
}

impl Budget for RequestDeadline {
    fn check(&self) -> Result<()> {
        if self.cancelled.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        if Instant::now() >= self.deadline { Err(self.exceeded()) } else { Ok(()) }
    }
}

impl CancelOnDrop {
    /// The response is ready: the guard no longer cancels.
    pub fn disarm(mut self) {
        self.0 = None;
    }
}

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        if let Some(deadline) = &self.0 {
            deadline.cancel();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_at_deadline_or_on_cancellation() {
        let deadline = RequestDeadline::after(Duration::from_secs(60));
        deadline.cancel_on_drop().disarm();
        assert!(deadline.check().is_ok());
        drop(deadline.cancel_on_drop());
        assert_eq!(deadline.check(), Err(Error::Cancelled));
        assert_eq!(RequestDeadline::after(Duration::ZERO).check(), Err(Error::Deadline { seconds: 0.0 }));
    }
}
