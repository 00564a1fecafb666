//! Turns at work, shared out between clients: who waits longest in its own line goes next, and the lines take turns.
//!
//! Fair queueing by client (Nagle, RFC 970, section 4) with as many servers as there are turns: one who sends a hundred requests
//! waits behind its own, not the others behind it. A client has at most so many turns at once, so that those of others begin at
//! once while there are turns left and the operating system shares the processors out between them.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

use super::client::Client;

/// Turns, handed out line by line.
pub struct Gate {
    most: usize,
    each: usize,
    now: Mutex<Now>,
}

#[derive(Default)]
struct Now {
    /// Turns handed out.
    held: usize,
    /// Of clients that hold or wait for a turn.
    lines: HashMap<Client, Line>,
    /// Clients of whom somebody waits, the next one first.
    next: VecDeque<Client>,
}

#[derive(Default)]
struct Line {
    held: usize,
    waiting: VecDeque<oneshot::Sender<Turn>>,
}

/// A turn; over when dropped.
pub struct Turn {
    gate: Arc<Gate>,
    client: Client,
}

/// Of this many in a line, those who no longer wait are let go.
const LONG: usize = 2048;

impl Gate {
    /// With so many turns at a time for all, and for each client.
    pub fn new(most: usize, each: usize) -> Arc<Gate> {
        Arc::new(Gate { most, each, now: Mutex::default() })
    }

    /// A client's next turn.
    pub async fn enter(self: &Arc<Gate>, client: &Client) -> Turn {
        match self.line_up(client) {
            Ok(turn) => turn,
            // A line is kept until all in it have had their turn.
            Err(wait) => match wait.await {
                Ok(turn) => turn,
                Err(_) => std::future::pending().await,
            },
        }
    }

    /// A turn at once, or what it comes by.
    fn line_up(self: &Arc<Gate>, client: &Client) -> Result<Turn, oneshot::Receiver<Turn>> {
        let mut guard = self.now();
        let now = &mut *guard;
        let free = now.held < self.most;
        let line = now.lines.entry(client.clone()).or_default();
        if line.waiting.iter().all(oneshot::Sender::is_closed) {
            line.waiting.clear();
        }
        if free && line.held < self.each && line.waiting.is_empty() {
            line.held += 1;
            now.held += 1;
            return Ok(Turn { gate: self.clone(), client: client.clone() });
        }
        if line.waiting.len() >= LONG {
            line.waiting.retain(|w| !w.is_closed());
        }
        let (call, wait) = oneshot::channel();
        line.waiting.push_back(call);
        if !now.next.contains(client) {
            now.next.push_back(client.clone());
        }
        Err(wait)
    }

    /// How many wait for their turn.
    pub fn waiting(&self) -> usize {
        let waits = |line: &Line| line.waiting.iter().filter(|w| !w.is_closed()).count();
        self.now().lines.values().map(waits).sum()
    }

    /// Calls those whose turn it is.
    fn call(self: &Arc<Gate>) {
        let mut called = Vec::new();
        {
            let mut now = self.now();
            while now.held < self.most {
                let Some((client, call)) = now.pop(self.each) else { break };
                now.held += 1;
                called.push((call, Turn { gate: self.clone(), client }));
            }
        }
        // Outside the lock: a turn that nobody takes any more is over, and the next is called.
        for (call, turn) in called {
            let _ = call.send(turn);
        }
    }

    fn leave(self: &Arc<Gate>, client: &Client) {
        {
            let mut now = self.now();
            now.held -= 1;
            if let Some(line) = now.lines.get_mut(client) {
                line.held -= 1;
                if line.held == 0 && line.waiting.is_empty() {
                    now.lines.remove(client);
                }
            }
        }
        self.call();
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Now {
    /// Whose turn it is, of those who may have one more; their line goes to the end.
    fn pop(&mut self, each: usize) -> Option<(Client, oneshot::Sender<Turn>)> {
        for _ in 0..self.next.len() {
            let client = self.next.pop_front()?;
            let Some(line) = self.lines.get_mut(&client) else { continue };
            while line.waiting.front().is_some_and(oneshot::Sender::is_closed) {
                line.waiting.pop_front();
            }
            let may = line.held < each;
            let call = if may { line.waiting.pop_front() } else { None };
            line.held += usize::from(call.is_some());
            if !line.waiting.is_empty() {
                self.next.push_back(client.clone());
            } else if line.held == 0 {
                self.lines.remove(&client);
            }
            if let Some(call) = call {
                return Some((client, call));
            }
        }
        None
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        self.gate.leave(&self.client);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(n: u8) -> Client {
        Client::at([10, 0, 0, n].into())
    }

    /// In the order in which they are called: whoever holds a turn gives it back as soon as all are in line.
    fn order(gate: &Arc<Gate>, asked: &[u8]) -> Vec<u8> {
        let held: Vec<Turn> =
            (0..gate.most as u8).map(|n| gate.line_up(&client(200 + n)).ok().unwrap()).collect();
        let mut waits: Vec<(u8, oneshot::Receiver<Turn>)> =
            asked.iter().map(|n| (*n, gate.line_up(&client(*n)).err().unwrap())).collect();
        assert_eq!(gate.waiting(), asked.len());
        drop(held);
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
    fn lines_take_turns_however_long_one_of_them_is() {
        let gate = Gate::new(1, 1);
        assert_eq!(order(&gate, &[1, 1, 1, 1, 1, 2, 2, 3]), [1, 2, 3, 1, 2, 1, 1, 1]);
        let now = gate.now();
        assert_eq!((now.held, now.lines.len(), now.next.len()), (0, 0, 0), "nothing is left behind");
    }

    #[test]
    fn a_client_has_so_many_turns_at_once_and_others_go_before_it() {
        let gate = Gate::new(4, 2);
        let flood: Vec<_> = (0..6).map(|_| gate.line_up(&client(1))).collect();
        assert_eq!(flood.iter().filter(|t| t.is_ok()).count(), 2);
        let other = gate.line_up(&client(2)).ok().expect("at once");
        assert_eq!(gate.waiting(), 4);
        drop((flood, other));
        assert_eq!((gate.waiting(), gate.now().held), (0, 0), "whoever has left is not called");
    }

    #[test]
    fn who_gives_up_waiting_or_does_not_take_its_turn_holds_up_nobody() {
        let gate = Gate::new(1, 1);
        let turn = gate.line_up(&client(1)).ok().unwrap();
        let (left, called, last) =
            (gate.line_up(&client(1)).err(), gate.line_up(&client(2)).err(), gate.line_up(&client(1)).err());
        drop(left);
        drop(turn);
        // The second has its turn, and goes without having looked.
        let mut last = last.unwrap();
        drop(called);
        assert!(last.try_recv().is_ok());
        assert_eq!(gate.now().lines.len(), 0);
    }
}
