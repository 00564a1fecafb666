//! How many of something there are, and how many of each client's: requests taken in, connections.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::client::Client;

/// Places, each taken by a client.
pub struct Crowd {
    room: Room,
    now: Mutex<Now>,
}

/// How many places there are.
#[derive(Clone, Copy)]
pub struct Room {
    /// For all.
    pub most: usize,
    /// For one client.
    pub each: usize,
    /// A client with fewer than this many is let in though there are `most` already, until there are twice as many: who fills
    /// the room keeps nobody else out.
    pub kept: usize,
}

#[derive(Default)]
struct Now {
    all: usize,
    of: HashMap<Client, usize>,
}

/// Why there is no place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Full {
    /// The client has as many as one may.
    Own,
    /// There are as many as there may be.
    All,
}

/// A place; given back when dropped.
pub struct Place {
    crowd: Arc<Crowd>,
    client: Client,
}

impl Crowd {
    pub fn new(room: Room) -> Arc<Crowd> {
        Arc::new(Crowd { room, now: Mutex::default() })
    }

    /// A place for a client.
    pub fn enter(self: &Arc<Crowd>, client: &Client) -> Result<Place, Full> {
        let mut now = self.now();
        let (own, Room { most, each, kept }) = (now.of(client), self.room);
        if own >= each {
            return Err(Full::Own);
        }
        if now.all >= most && (own >= kept || now.all >= 2 * most) {
            return Err(Full::All);
        }
        now.add(client);
        Ok(Place { crowd: self.clone(), client: client.clone() })
    }

    /// The same, whatever there is: where another place was given up for it, which is not free yet.
    pub fn squeeze(self: &Arc<Crowd>, client: &Client) -> Place {
        self.now().add(client);
        Place { crowd: self.clone(), client: client.clone() }
    }

    /// Places taken.
    pub fn all(&self) -> usize {
        self.now().all
    }

    /// Places that a client has taken.
    pub fn of(&self, client: &Client) -> usize {
        self.now().of(client)
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Place {
    /// Whose it is.
    pub fn client(&self) -> &Client {
        &self.client
    }

    /// It is another client's from now on.
    pub fn pass(&mut self, to: &Client) {
        let mut now = self.crowd.now();
        now.remove(&self.client);
        now.add(to);
        self.client = to.clone();
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.crowd.now().remove(&self.client);
    }
}

impl Now {
    fn of(&self, client: &Client) -> usize {
        self.of.get(client).copied().unwrap_or(0)
    }

    fn add(&mut self, client: &Client) {
        self.all += 1;
        *self.of.entry(client.clone()).or_default() += 1;
    }

    /// Who has none is not remembered.
    fn remove(&mut self, client: &Client) {
        self.all -= 1;
        if let Some(own) = self.of.get_mut(client) {
            *own -= 1;
            if *own == 0 {
                self.of.remove(client);
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
    fn who_fills_the_room_keeps_nobody_else_out_and_who_leaves_is_forgotten() {
        let crowd = Crowd::new(Room { most: 8, each: 8, kept: 2 });
        let mut flood: Vec<Place> = (0..8).map(|_| crowd.enter(&client(1)).ok().unwrap()).collect();
        assert_eq!(crowd.enter(&client(1)).err(), Some(Full::Own));
        let _two = [crowd.enter(&client(2)).ok().unwrap(), crowd.enter(&client(2)).ok().unwrap()];
        assert_eq!(crowd.enter(&client(2)).err(), Some(Full::All));
        let others: Vec<Place> = (3..9).filter_map(|n| crowd.enter(&client(n)).ok()).collect();
        assert_eq!((others.len(), crowd.all()), (6, 16), "twice the room is the end of it");
        assert_eq!(crowd.enter(&client(9)).err(), Some(Full::All));
        flood[0].pass(&client(9));
        assert_eq!((crowd.of(&client(1)), crowd.of(&client(9)), crowd.all()), (7, 1, 16));
        drop(flood);
        assert_eq!((crowd.of(&client(1)), crowd.all()), (0, 8));
        assert_eq!(crowd.now().of.len(), 7);
    }
}
