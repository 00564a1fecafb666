//! Registry of HTTP connections and the client of each: its peer address, until a request authenticates by a token.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use super::timeouts::ConnectionTimer;
use crate::serve::client::Client;
use crate::serve::client_limiter::{ClientLimiter, LimitReached, LimiterPermit};
use crate::serve::limits::Limits;
use crate::sync::lock;

/// Open connections, by number.
pub struct ConnectionRegistry {
    limiter: Arc<ClientLimiter>,
    connections: Mutex<HashMap<u64, Arc<ConnectionHandle>>>,
}

/// One connection, as an extension of its requests.
pub struct ConnectionHandle {
    registry: Arc<ConnectionRegistry>,
    /// Client at the peer address.
    peer: Client,
    permit: Mutex<LimiterPermit>,
    timer: Arc<ConnectionTimer>,
}

impl ConnectionRegistry {
    /// An empty registry; connections are counted by the limiter.
    pub fn new(limiter: Arc<ClientLimiter>) -> Arc<ConnectionRegistry> {
        Arc::new(ConnectionRegistry { limiter, connections: Mutex::default() })
    }

    /// Registers a new connection, closing an idle one if necessary; `None` if all are busy.
    pub fn register(
        self: &Arc<ConnectionRegistry>,
        number: u64,
        peer: Client,
        limits: &Limits,
    ) -> Option<Arc<ConnectionHandle>> {
        let permit = match self.limiter.acquire(&peer) {
            Ok(permit) => permit,
            Err(LimitReached::PerClient) if self.evict(Some(&peer)) => self.limiter.acquire_over_limit(&peer),
            Err(LimitReached::Total) if self.evict(None) => self.limiter.acquire_over_limit(&peer),
            Err(_) => return None,
        };
        let (registry, timer) = (self.clone(), ConnectionTimer::new(limits));
        let handle = Arc::new(ConnectionHandle { registry, peer, permit: Mutex::new(permit), timer });
        lock(&self.connections).insert(number, handle.clone());
        Some(handle)
    }

    /// Removes a connection that has ended.
    pub fn remove(&self, number: u64) {
        lock(&self.connections).remove(&number);
    }

    /// Closes an idle connection, of this client or of any: of the client with the most connections, the one idle longest. Returns
    /// whether there was one.
    pub fn evict(&self, of: Option<&Client>) -> bool {
        let mut connections = lock(&self.connections);
        let waiting = connections.iter().filter_map(|(number, handle)| {
            let (client, since) = (handle.client(), handle.timer.idle_since()?);
            let ours = of.is_none_or(|of| *of == client);
            ours.then(|| (std::cmp::Reverse(self.limiter.count(&client)), since, *number))
        });
        let Some((.., number)) = waiting.min() else { return false };
        connections.remove(&number).is_some_and(|handle| {
            handle.timer.evict();
            true
        })
    }
}

impl ConnectionHandle {
    /// Client at the peer address.
    pub fn peer(&self) -> &Client {
        &self.peer
    }

    /// Its timeouts.
    pub fn timer(&self) -> &Arc<ConnectionTimer> {
        &self.timer
    }

    /// Assigns the connection to an authenticated client. False if the client has too many connections, all of them busy.
    pub fn assign_to(&self, client: &Client) -> bool {
        {
            let mut permit = lock(&self.permit);
            if permit.client() == client {
                return true;
            }
            permit.transfer(client);
        }
        if self.registry.limiter.count(client) <= self.registry.limiter.max_per_client()
            || self.registry.evict(Some(client))
        {
            return true;
        }
        lock(&self.permit).transfer(&self.peer);
        false
    }

    fn client(&self) -> Client {
        lock(&self.permit).client().clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::{Principal, Scope};
    use crate::serve::client_limiter::LimiterCapacity;

    fn at(n: u8) -> Client {
        Client::at([10, 0, 0, n].into())
    }

    fn named(name: &str) -> Client {
        Client::identify(&Principal { name: Some(name.into()), scope: Scope::Act }, &at(0))
    }

    /// Connections 1 to 3 from one address and 4 from another, with a capacity of 4.
    fn full(per_client: usize) -> (Arc<ConnectionRegistry>, Vec<Arc<ConnectionHandle>>) {
        let limits = Limits { connections: 4, client_connections: per_client, ..Limits::default() };
        let limiter = ClientLimiter::new(LimiterCapacity { total: 4, per_client, reserved_per_client: 0 });
        let registry = ConnectionRegistry::new(limiter);
        let handles = (1..=4).map(|n| registry.register(n, at(u8::from(n == 4)), &limits).unwrap()).collect();
        (registry, handles)
    }

    fn there(registry: &ConnectionRegistry) -> Vec<u64> {
        let mut all: Vec<u64> = lock(&registry.connections).keys().copied().collect();
        all.sort_unstable();
        all
    }

    #[test]
    fn evicts_idle_connection_of_largest_client() {
        let (registry, handles) = full(4);
        let busy = handles[0].timer().start_request();
        assert!(registry.register(5, at(2), &Limits::default()).is_some());
        assert_eq!(there(&registry), [1, 3, 4, 5], "of the three, the first that waits");
        let all_busy: Vec<_> = [1, 2, 3].map(|i| handles[i].timer().start_request()).into();
        lock(&registry.connections).remove(&5);
        assert!(registry.register(6, at(2), &Limits::default()).is_none(), "all are busy");
        drop((busy, all_busy));
    }

    #[test]
    fn evicts_own_idle_connection() {
        let (registry, handles) = full(3);
        let limits = Limits::default();
        lock(&registry.connections).remove(&4);
        drop(handles.into_iter().nth(3));
        assert!(registry.register(5, at(0), &limits).is_some());
        assert_eq!(there(&registry), [2, 3, 5]);
    }

    #[test]
    fn counts_connections_by_token() {
        let (registry, handles) = full(3);
        // The connection that sends the request is busy.
        let _asks = handles[0].timer().start_request();
        for handle in &handles[1..] {
            assert!(handle.assign_to(&named("ann")));
        }
        let busy: Vec<_> = handles[1..].iter().map(|handle| handle.timer().start_request()).collect();
        assert!(!handles[0].assign_to(&named("ann")), "three are busy");
        assert!(handles[0].assign_to(&named("bob")));
        drop(busy);
        assert!(handles[0].assign_to(&named("ann")), "one of the three waits, and goes");
        assert_eq!(there(&registry).len(), 3);
    }
}
