//! A semaphore with fair queueing by client: permits are granted round-robin over the clients' queues.
//!
//! Fair queueing (Nagle, RFC 970, section 4) with as many servers as there are permits: a client that sends a hundred requests
//! waits behind its own, and the others do not wait behind it. Each client has a maximum number of permits, so that requests of
//! others start at once while permits are available.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard};

use tokio::sync::oneshot;

use super::client::Client;
use crate::sync::lock;

/// A fair semaphore.
pub struct FairSemaphore {
    permits: usize,
    per_client: usize,
    state: Mutex<SemaphoreState>,
}

#[derive(Default)]
struct SemaphoreState {
    /// Permits in use.
    in_use: usize,
    /// Queues of clients that hold or wait for a permit.
    queues: HashMap<Client, ClientQueue>,
    /// Clients with waiters, in round-robin order.
    round_robin: VecDeque<Client>,
}

#[derive(Default)]
struct ClientQueue {
    in_use: usize,
    waiting: VecDeque<oneshot::Sender<FairPermit>>,
}

/// A permit; released when dropped.
pub struct FairPermit {
    semaphore: Arc<FairSemaphore>,
    client: Client,
}

/// Queue length from which cancelled waiters are pruned.
const PRUNE_QUEUE_LENGTH: usize = 2048;

impl FairSemaphore {
    /// With this many permits in total and for each client.
    pub fn new(permits: usize, per_client: usize) -> Arc<FairSemaphore> {
        Arc::new(FairSemaphore { permits, per_client, state: Mutex::default() })
    }

    /// Waits for a permit.
    pub async fn acquire(self: &Arc<FairSemaphore>, client: &Client) -> FairPermit {
        match self.acquire_or_enqueue(client) {
            Ok(permit) => permit,
            // A queue exists until all its waiters had a permit.
            Err(wait) => match wait.await {
                Ok(permit) => permit,
                Err(_) => std::future::pending().await,
            },
        }
    }

    /// A permit, or the receiver to wait on.
    fn acquire_or_enqueue(
        self: &Arc<FairSemaphore>,
        client: &Client,
    ) -> Result<FairPermit, oneshot::Receiver<FairPermit>> {
        let mut guard = self.state();
        let state = &mut *guard;
        let free = state.in_use < self.permits;
        let queue = state.queues.entry(client.clone()).or_default();
        if queue.waiting.iter().all(oneshot::Sender::is_closed) {
            queue.waiting.clear();
        }
        if free && queue.in_use < self.per_client && queue.waiting.is_empty() {
            queue.in_use += 1;
            state.in_use += 1;
            return Ok(FairPermit { semaphore: self.clone(), client: client.clone() });
        }
        if queue.waiting.len() >= PRUNE_QUEUE_LENGTH {
            queue.waiting.retain(|w| !w.is_closed());
        }
        let (call, wait) = oneshot::channel();
        queue.waiting.push_back(call);
        if !state.round_robin.contains(client) {
            state.round_robin.push_back(client.clone());
        }
        Err(wait)
    }

    /// Number of waiters.
    pub fn waiting(&self) -> usize {
        let waits = |queue: &ClientQueue| queue.waiting.iter().filter(|w| !w.is_closed()).count();
        self.state().queues.values().map(waits).sum()
    }

    /// Grants free permits.
    fn grant(self: &Arc<FairSemaphore>) {
        let mut called = Vec::new();
        {
            let mut state = self.state();
            while state.in_use < self.permits {
                let Some((client, call)) = state.next_waiter(self.per_client) else { break };
                state.in_use += 1;
                called.push((call, FairPermit { semaphore: self.clone(), client }));
            }
        }
        // Outside the lock: a permit whose receiver was dropped is released, which grants the next.
        for (call, permit) in called {
            let _ = call.send(permit);
        }
    }

    fn release(self: &Arc<FairSemaphore>, client: &Client) {
        {
            let mut state = self.state();
            state.in_use -= 1;
            if let Some(queue) = state.queues.get_mut(client) {
                queue.in_use -= 1;
                if queue.in_use == 0 && queue.waiting.is_empty() {
                    state.queues.remove(client);
                }
            }
        }
        self.grant();
    }

    fn state(&self) -> MutexGuard<'_, SemaphoreState> {
        lock(&self.state)
    }
}

impl SemaphoreState {
    /// The next waiter among clients below their limit; its client moves to the end of the round.
    fn next_waiter(&mut self, per_client: usize) -> Option<(Client, oneshot::Sender<FairPermit>)> {
        for _ in 0..self.round_robin.len() {
            let client = self.round_robin.pop_front()?;
            let Some(queue) = self.queues.get_mut(&client) else { continue };
            while queue.waiting.front().is_some_and(oneshot::Sender::is_closed) {
                queue.waiting.pop_front();
            }
            let may = queue.in_use < per_client;
            let call = if may { queue.waiting.pop_front() } else { None };
            queue.in_use += usize::from(call.is_some());
            if !queue.waiting.is_empty() {
                self.round_robin.push_back(client.clone());
            } else if queue.in_use == 0 {
                self.queues.remove(&client);
            }
            if let Some(call) = call {
                return Some((client, call));
            }
        }
        None
    }
}

impl Drop for FairPermit {
    fn drop(&mut self) {
        self.semaphore.release(&self.client);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(n: u8) -> Client {
        Client::at([10, 0, 0, n].into())
    }

    /// The order in which waiters get their permit if each releases it at once.
    fn order(semaphore: &Arc<FairSemaphore>, waiting_clients: &[u8]) -> Vec<u8> {
        let in_use: Vec<FairPermit> = (0..semaphore.permits as u8)
            .map(|n| semaphore.acquire_or_enqueue(&client(200 + n)).ok().unwrap())
            .collect();
        let mut waits: Vec<(u8, oneshot::Receiver<FairPermit>)> = waiting_clients
            .iter()
            .map(|n| (*n, semaphore.acquire_or_enqueue(&client(*n)).err().unwrap()))
            .collect();
        assert_eq!(semaphore.waiting(), waiting_clients.len());
        drop(in_use);
        let mut called = Vec::new();
        while let Some(at) = waits.iter_mut().position(|(_, w)| !w.is_empty()) {
            let (n, mut wait) = waits.remove(at);
            drop(wait.try_recv().unwrap());
            called.push(n);
        }
        assert!(waits.is_empty());
        called
    }

    #[test]
    fn grants_round_robin() {
        let semaphore = FairSemaphore::new(1, 1);
        assert_eq!(order(&semaphore, &[1, 1, 1, 1, 1, 2, 2, 3]), [1, 2, 3, 1, 2, 1, 1, 1]);
        let state = semaphore.state();
        assert_eq!(
            (state.in_use, state.queues.len(), state.round_robin.len()),
            (0, 0, 0),
            "nothing is left behind"
        );
    }

    #[test]
    fn limits_permits_per_client() {
        let semaphore = FairSemaphore::new(4, 2);
        let flood: Vec<_> = (0..6).map(|_| semaphore.acquire_or_enqueue(&client(1))).collect();
        assert_eq!(flood.iter().filter(|t| t.is_ok()).count(), 2);
        let other = semaphore.acquire_or_enqueue(&client(2)).ok().expect("at once");
        assert_eq!(semaphore.waiting(), 4);
        drop((flood, other));
        assert_eq!((semaphore.waiting(), semaphore.state().in_use), (0, 0), "whoever has left is not called");
    }

    #[test]
    fn cancelled_waiters_release_permits() {
        let semaphore = FairSemaphore::new(1, 1);
        let permit = semaphore.acquire_or_enqueue(&client(1)).ok().unwrap();
        let (left, called, last) = (
            semaphore.acquire_or_enqueue(&client(1)).err(),
            semaphore.acquire_or_enqueue(&client(2)).err(),
            semaphore.acquire_or_enqueue(&client(1)).err(),
        );
        drop(left);
        drop(permit);
        // The second waiter gets its permit and drops it unused.
        let mut last = last.unwrap();
        drop(called);
        assert!(last.try_recv().is_ok());
        assert_eq!(semaphore.state().queues.len(), 0);
    }
}
