//! Counting limits, in total and per client: admitted requests, connections, bytes of requests in progress.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard};

use super::client::Client;
use crate::sync::lock;

/// Limits the number of units (requests, connections, bytes) in use, in total and per client.
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
    /// A client with fewer units than this gets more beyond `total`, up to twice `total`: a client that uses up the capacity
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

/// A permit for some units; released when dropped.
pub struct LimiterPermit {
    limiter: Arc<ClientLimiter>,
    client: Client,
    units: usize,
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

    /// Maximum number of units of one client.
    pub fn max_per_client(&self) -> usize {
        self.counts().capacity.per_client
    }

    /// A permit for one unit.
    pub fn acquire(self: &Arc<ClientLimiter>, client: &Client) -> Result<LimiterPermit, LimitReached> {
        let mut permit = self.empty_permit(client);
        permit.grow(1)?;
        Ok(permit)
    }

    /// A permit for one unit regardless of the limits: another connection was closed for it and has not released its permit yet.
    pub fn acquire_over_limit(self: &Arc<ClientLimiter>, client: &Client) -> LimiterPermit {
        let mut permit = self.empty_permit(client);
        self.counts().add(client, 1);
        permit.units = 1;
        permit
    }

    /// A permit for no units yet.
    pub fn empty_permit(self: &Arc<ClientLimiter>, client: &Client) -> LimiterPermit {
        LimiterPermit { limiter: self.clone(), client: client.clone(), units: 0 }
    }

    /// Units in use.
    pub fn total(&self) -> usize {
        self.counts().all
    }

    /// Units in use by a client.
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

    /// Adds units, or none if a limit is reached.
    pub fn grow(&mut self, units: usize) -> Result<(), LimitReached> {
        let mut counts = self.limiter.counts();
        let (own, LimiterCapacity { total, per_client, reserved_per_client }) =
            (counts.count(&self.client), counts.capacity);
        if own + units > per_client {
            return Err(LimitReached::PerClient);
        }
        let all = counts.all + units;
        if all > total && (own >= reserved_per_client || all > 2 * total) {
            return Err(LimitReached::Total);
        }
        counts.add(&self.client, units);
        drop(counts);
        self.units += units;
        Ok(())
    }

    /// Transfers the permit to another client.
    pub fn transfer(&mut self, to: &Client) {
        let mut counts = self.limiter.counts();
        counts.remove(&self.client, self.units);
        counts.add(to, self.units);
        self.client = to.clone();
    }
}

impl Drop for LimiterPermit {
    fn drop(&mut self) {
        self.limiter.counts().remove(&self.client, self.units);
    }
}

impl ClientCounts {
    fn count(&self, client: &Client) -> usize {
        self.by_client.get(client).copied().unwrap_or(0)
    }

    fn add(&mut self, client: &Client, units: usize) {
        self.all += units;
        *self.by_client.entry(client.clone()).or_default() += units;
    }

    /// Clients without units are removed from the map.
    fn remove(&mut self, client: &Client, units: usize) {
        self.all -= units;
        if let Some(own) = self.by_client.get_mut(client) {
            *own -= units;
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

    #[test]
    fn bounds_bytes_of_one_client_and_of_all() {
        let capacity = LimiterCapacity { total: 100, per_client: 60, reserved_per_client: 0 };
        let limiter = ClientLimiter::new(capacity);
        let permit = |n| limiter.empty_permit(&client(n));
        let (mut first, mut second, mut other) = (permit(1), permit(1), permit(2));
        assert_eq!((first.grow(40), second.grow(20)), (Ok(()), Ok(())));
        assert_eq!(second.grow(1), Err(LimitReached::PerClient));
        assert_eq!((other.grow(40), other.grow(1)), (Ok(()), Err(LimitReached::Total)));
        drop(first);
        assert_eq!((second.grow(40), second.grow(1)), (Ok(()), Err(LimitReached::PerClient)));
        assert_eq!(other.grow(1), Err(LimitReached::Total));
        drop((second, other));
        assert!(limiter.counts().by_client.is_empty() && limiter.total() == 0);
    }
}
