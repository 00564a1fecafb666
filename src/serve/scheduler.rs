//! Fair sharing of the server between clients: one semaphore for each execution class.
//!
//! | class | permits | per client | reason |
//! |---|---|---|---|
//! | compute | four a core, at least 16 | one a core, at least 2 | more permits than cores, so that other clients' requests start at once |
//! | blocking | 16 | 8 | waits for the disk or for a world |
//! | streaming | 32 | 8 | waits for the client |
//! | inline | any | one, with several clients | runs on the few async threads |
//!
//! An inline request needs no permit while only one client is active. With several, a client runs one at a time and yields
//! before it, so that its other requests wait in its own queue.

use std::sync::{Arc, Mutex};
use std::thread::available_parallelism;
use std::time::{Duration, Instant};

use super::client::Client;
use super::client_limiter::{ClientLimiter, LimiterCapacity};
use super::fair_semaphore::{FairPermit, FairSemaphore};
use crate::sync::lock;

/// The server's semaphores and its admission limit.
pub struct FairScheduler {
    /// Admitted requests.
    pub admitted: Arc<ClientLimiter>,
    /// Permits of class compute.
    pub compute: Arc<FairSemaphore>,
    /// Permits of class blocking.
    pub blocking: Arc<FairSemaphore>,
    /// Permits of streaming responses.
    pub streaming: Arc<FairSemaphore>,
    inline: Arc<FairSemaphore>,
    recent_clients: Mutex<RecentClients>,
}

/// Maximum requests admitted at a time; more are answered with 429.
pub const MAX_ADMITTED_REQUESTS: usize = 512;
/// A client with fewer admitted requests is admitted although the server is full.
const RESERVED_REQUESTS_PER_CLIENT: usize = MAX_ADMITTED_REQUESTS / 8;
const BLOCKING_PERMITS: usize = 16;
const STREAMING_PERMITS: usize = 32;
/// Permits of one client in the blocking and streaming classes.
const IO_PERMITS_PER_CLIENT: usize = 8;
/// How long a client counts as active after a request.
const CLIENT_RECENCY: Duration = Duration::from_millis(100);

/// The last client, and until when several clients count as active.
struct RecentClients {
    last: Option<Client>,
    until: Option<Instant>,
}

impl FairScheduler {
    /// With all permits available.
    pub fn new() -> FairScheduler {
        let cores = cores();
        FairScheduler {
            admitted: ClientLimiter::new(LimiterCapacity {
                total: MAX_ADMITTED_REQUESTS,
                per_client: usize::MAX,
                reserved_per_client: RESERVED_REQUESTS_PER_CLIENT,
            }),
            compute: FairSemaphore::new(compute_permits(cores), cores.max(2)),
            blocking: FairSemaphore::new(BLOCKING_PERMITS, IO_PERMITS_PER_CLIENT),
            streaming: FairSemaphore::new(STREAMING_PERMITS, IO_PERMITS_PER_CLIENT),
            inline: FairSemaphore::new(usize::MAX, 1),
            recent_clients: Mutex::new(RecentClients { last: None, until: None }),
        }
    }

    /// Maximum blocking threads, for all permits and the server's own tasks. Each further thread would keep a stack and an
    /// allocator arena.
    pub fn max_blocking_threads() -> usize {
        compute_permits(cores()) + BLOCKING_PERMITS + STREAMING_PERMITS + 8
    }

    /// A permit for an inline request; `None` while the client is the only active one.
    pub async fn acquire_inline(&self, client: &Client) -> Option<FairPermit> {
        if !self.has_contention(client) {
            return None;
        }
        let permit = self.inline.acquire(client).await;
        tokio::task::yield_now().await;
        Some(permit)
    }

    /// Number of requests that wait for a permit.
    pub fn waiting(&self) -> usize {
        [&self.compute, &self.blocking, &self.streaming, &self.inline]
            .map(|semaphore| semaphore.waiting())
            .iter()
            .sum()
    }

    /// Whether other clients were active recently.
    fn has_contention(&self, client: &Client) -> bool {
        let mut recent_clients = lock(&self.recent_clients);
        let now = Instant::now();
        if recent_clients.last.as_ref() != Some(client) {
            let first = recent_clients.last.replace(client.clone()).is_none();
            recent_clients.until = (!first).then(|| now + CLIENT_RECENCY);
        }
        recent_clients.until.is_some_and(|until| now < until)
    }
}

fn cores() -> usize {
    available_parallelism().map_or(1, |n| n.get())
}

fn compute_permits(cores: usize) -> usize {
    (4 * cores).max(16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn inline_permits_only_under_contention() {
        let scheduler = FairScheduler::new();
        let (ann, bob) = (Client::at([10, 0, 0, 1].into()), Client::at([10, 0, 0, 2].into()));
        for _ in 0..3 {
            assert!(scheduler.acquire_inline(&ann).await.is_none());
        }
        let first = scheduler.acquire_inline(&bob).await.expect("ann was here a moment ago");
        assert!(scheduler.acquire_inline(&ann).await.is_some());
        let (second, other) = (scheduler.acquire_inline(&bob), scheduler.acquire_inline(&ann));
        tokio::pin!(second);
        assert!(other.await.is_some());
        tokio::select! {
            biased;
            _ = &mut second => panic!("bob has one at a time"),
            () = std::future::ready(()) => {}
        }
        assert_eq!(scheduler.waiting(), 1);
        drop(first);
        assert!(second.await.is_some());
    }
}
