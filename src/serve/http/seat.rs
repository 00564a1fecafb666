//! Connections there are, and whose each of them is: its address's, until a request shows a token.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::timed::Watch;
use crate::serve::client::Client;
use crate::serve::crowd::{Crowd, Full, Place};
use crate::serve::limits::Limits;

/// Connections there are, by number.
pub struct Open {
    crowd: Arc<Crowd>,
    most_of_one: usize,
    connections: Mutex<HashMap<u64, Arc<Seat>>>,
}

/// One connection, as its requests know it.
pub struct Seat {
    open: Arc<Open>,
    /// Where its client is.
    from: Client,
    place: Mutex<Place>,
    watch: Arc<Watch>,
}

impl Open {
    /// None yet; they are counted in `crowd`.
    pub fn new(crowd: Arc<Crowd>, limits: &Limits) -> Arc<Open> {
        Arc::new(Open { crowd, most_of_one: limits.client_connections, connections: Mutex::default() })
    }

    /// Takes a new connection in, in place of one that waits if need be; none if all are busy.
    pub fn take(self: &Arc<Open>, number: u64, from: Client, limits: &Limits) -> Option<Arc<Seat>> {
        let place = match self.crowd.enter(&from) {
            Ok(place) => place,
            Err(Full::Own) if self.evict(Some(&from)) => self.crowd.squeeze(&from),
            Err(Full::All) if self.evict(None) => self.crowd.squeeze(&from),
            Err(_) => return None,
        };
        let (open, watch) = (self.clone(), Watch::new(limits));
        let seat = Arc::new(Seat { open, from, place: Mutex::new(place), watch });
        lock(&self.connections).insert(number, seat.clone());
        Some(seat)
    }

    /// A connection has ended.
    pub fn leave(&self, number: u64) {
        lock(&self.connections).remove(&number);
    }

    /// Hangs up on a connection, a client's or anybody's, that asks for nothing: of the client who has most, the one that has
    /// waited longest. Whether there was one.
    pub fn evict(&self, of: Option<&Client>) -> bool {
        let mut connections = lock(&self.connections);
        let waiting = connections.iter().filter_map(|(number, seat)| {
            let (client, since) = (seat.client(), seat.watch.waits_since()?);
            let ours = of.is_none_or(|of| *of == client);
            ours.then(|| (std::cmp::Reverse(self.crowd.of(&client)), since, *number))
        });
        let Some((.., number)) = waiting.min() else { return false };
        connections.remove(&number).is_some_and(|seat| {
            seat.watch.evict();
            true
        })
    }
}

impl Seat {
    /// Where its client is.
    pub fn from(&self) -> &Client {
        &self.from
    }

    /// Its times.
    pub fn watch(&self) -> &Arc<Watch> {
        &self.watch
    }

    /// A request has shown whose it is. False where the client has too many, all of them busy: it is none of them.
    pub fn is_of(&self, client: &Client) -> bool {
        {
            let mut place = lock(&self.place);
            if place.client() == client {
                return true;
            }
            place.pass(client);
        }
        if self.open.crowd.of(client) <= self.open.most_of_one || self.open.evict(Some(client)) {
            return true;
        }
        lock(&self.place).pass(&self.from);
        false
    }

    fn client(&self) -> Client {
        lock(&self.place).client().clone()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::{Scope, Who};
    use crate::serve::crowd::Room;

    fn at(n: u8) -> Client {
        Client::at([10, 0, 0, n].into())
    }

    fn named(name: &str) -> Client {
        Client::of(&Who { name: Some(name.into()), scope: Scope::Act }, &at(0))
    }

    /// With connections 1 to 3 from one address and 4 from another, of 4 there may be.
    fn full(each: usize) -> (Arc<Open>, Vec<Arc<Seat>>) {
        let limits = Limits { connections: 4, client_connections: each, ..Limits::default() };
        let crowd = Crowd::new(Room { most: 4, each, kept: 0 });
        let open = Open::new(crowd, &limits);
        let seats = (1..=4).map(|n| open.take(n, at(u8::from(n == 4)), &limits).unwrap()).collect();
        (open, seats)
    }

    fn there(open: &Open) -> Vec<u64> {
        let mut all: Vec<u64> = lock(&open.connections).keys().copied().collect();
        all.sort_unstable();
        all
    }

    #[test]
    fn one_too_many_takes_the_place_of_one_of_whoever_has_most() {
        let (open, seats) = full(4);
        let busy = seats[0].watch().begin();
        assert!(open.take(5, at(2), &Limits::default()).is_some());
        assert_eq!(there(&open), [1, 3, 4, 5], "of the three, the first that waits");
        let all_busy: Vec<_> = [1, 2, 3].map(|i| seats[i].watch().begin()).into();
        lock(&open.connections).remove(&5);
        assert!(open.take(6, at(2), &Limits::default()).is_none(), "all are busy");
        drop((busy, all_busy));
    }

    #[test]
    fn one_too_many_of_a_client_takes_the_place_of_its_own() {
        let (open, seats) = full(3);
        let limits = Limits::default();
        lock(&open.connections).remove(&4);
        drop(seats.into_iter().nth(3));
        assert!(open.take(5, at(0), &limits).is_some());
        assert_eq!(there(&open), [2, 3, 5]);
    }

    #[test]
    fn a_token_has_its_connections_wherever_they_come_from() {
        let (open, seats) = full(3);
        // The one that asks is busy with it.
        let _asks = seats[0].watch().begin();
        for seat in &seats[1..] {
            assert!(seat.is_of(&named("ann")));
        }
        let busy: Vec<_> = seats[1..].iter().map(|seat| seat.watch().begin()).collect();
        assert!(!seats[0].is_of(&named("ann")), "three are busy");
        assert!(seats[0].is_of(&named("bob")));
        drop(busy);
        assert!(seats[0].is_of(&named("ann")), "one of the three waits, and goes");
        assert_eq!(there(&open).len(), 3);
    }
}
