//! Counting limits, in total and per client: admitted requests, connections.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard};

use super::client::Client;
use crate::sync::lock;

/// Limits the number of permits, in total and per client.
pub struct ClientLimiter {
    counts: Mutex<ClientCounts>,
}

/// Capacity of a limiter.
#[derive(Clone, Copy)]
pub struct LimiterCapacity {
    /// In total.
    pub total: usize,
    /// For one client.
    pub per_client: usize,
    /// A client with fewer permits than this gets one beyond `total`, up to twice `total`: a client that uses up the capacity
    /// does not lock out the others.
    pub reserved_per_client: usize,
}

struct ClientCounts {
    capacity: LimiterCapacity,
    all: usize,
    by_client: HashMap<Client, usize>,
}

/// Which limit was reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LimitReached {
    /// The client's own.
    PerClient,
    /// The total.
    Total,
}

/// A permit; released when dropped.
pub struct LimiterPermit {
    limiter: Arc<ClientLimiter>,
    client: Client,
}

impl ClientLimiter {
    pub fn new(capacity: LimiterCapacity) -> Arc<ClientLimiter> {
        let counts = ClientCounts { capacity, all: 0, by_client: HashMap::new() };
        Arc::new(ClientLimiter { counts: Mutex::new(counts) })
    }

    /// Sets the capacity; permits in use stay.
    pub fn set_capacity(&self, capacity: LimiterCapacity) {
        self.counts().capacity = capacity;
    }

    /// Maximum number of permits of one client.
    pub fn max_per_client(&self) -> usize {
        self.counts().capacity.per_client
    }

    /// A permit for a client.
    pub fn acquire(self: &Arc<ClientLimiter>, client: &Client) -> Result<LimiterPermit, LimitReached> {
        let mut counts = self.counts();
        let (own, LimiterCapacity { total, per_client, reserved_per_client }) =
            (counts.count(client), counts.capacity);
        if own >= per_client {
            return Err(LimitReached::PerClient);
        }
        if counts.all >= total && (own >= reserved_per_client || counts.all >= 2 * total) {
            return Err(LimitReached::Total);
        }
        counts.add(client);
        Ok(LimiterPermit { limiter: self.clone(), client: client.clone() })
    }

    /// A permit regardless of the limits: another connection was closed for it and has not released its permit yet.
    pub fn acquire_over_limit(self: &Arc<ClientLimiter>, client: &Client) -> LimiterPermit {
        self.counts().add(client);
        LimiterPermit { limiter: self.clone(), client: client.clone() }
    }

    /// Permits in use.
    pub fn total(&self) -> usize {
        self.counts().all
    }

    /// Permits in use by a client.
    pub fn count(&self, client: &Client) -> usize {
        self.counts().count(client)
    }

    fn counts(&self) -> MutexGuard<'_, ClientCounts> {
        lock(&self.counts)
    }
}

impl LimiterPermit {
    /// The client that holds it.
    pub fn client(&self) -> &Client {
        &self.client
    }

    /// Transfers the permit to another client.
    pub fn transfer(&mut self, to: &Client) {
        let mut counts = self.limiter.counts();
        counts.remove(&self.client);
        counts.add(to);
        self.client = to.clone();
    }
}

impl Drop for LimiterPermit {
    fn drop(&mut self) {
        self.limiter.counts().remove(&self.client);
    }
}

impl ClientCounts {
    fn count(&self, client: &Client) -> usize {
        self.by_client.get(client).copied().unwrap_or(0)
    }

    fn add(&mut self, client: &Client) {
        self.all += 1;
        *self.by_client.entry(client.clone()).or_default() += 1;
    }

    /// Clients without permits are removed from the map.
    fn remove(&mut self, client: &Client) {
        self.all -= 1;
        if let Some(own) = self.by_client.get_mut(client) {
            *own -= 1;
            if *own == 0 {
                self.by_client.remove(client);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(n: u8) -> Client {
        Client::at([10, 0, 0, n].into())
    }

    #[test]
    fn reserves_capacity_for_other_clients() {
        let limiter = ClientLimiter::new(LimiterCapacity { total: 8, per_client: 8, reserved_per_client: 2 });
        let mut flood: Vec<LimiterPermit> =
            (0..8).map(|_| limiter.acquire(&client(1)).ok().unwrap()).collect();
        assert_eq!(limiter.acquire(&client(1)).err(), Some(LimitReached::PerClient));
        let _two = [limiter.acquire(&client(2)).ok().unwrap(), limiter.acquire(&client(2)).ok().unwrap()];
        assert_eq!(limiter.acquire(&client(2)).err(), Some(LimitReached::Total));
        let others: Vec<LimiterPermit> = (3..9).filter_map(|n| limiter.acquire(&client(n)).ok()).collect();
        assert_eq!((others.len(), limiter.total()), (6, 16), "twice the capacity is the end of it");
        assert_eq!(limiter.acquire(&client(9)).err(), Some(LimitReached::Total));
        flood[0].transfer(&client(9));
        assert_eq!((limiter.count(&client(1)), limiter.count(&client(9)), limiter.total()), (7, 1, 16));
        drop(flood);
        assert_eq!((limiter.count(&client(1)), limiter.total()), (0, 8));
        assert_eq!(limiter.counts().by_client.len(), 7);
    }
}
