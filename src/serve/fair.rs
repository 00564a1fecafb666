//! How the server shares itself out between clients: a gate for each kind of work.
//!
//! | work | turns for all | for a client | |
//! |---|---|---|---|
//! | computes | four a core, at least 16 | one a core, at least 2 | as many as make it faster; the others' begin beside them |
//! | else | 16 | 8 | waits for the disk, or for a world |
//! | streams | 32 | 8 | waits for its client |
//! | light | any | one, while others ask | is done on the threads that read requests, of which there are few |
//!
//! A light request takes no turn while one client is alone. While there are others, a client has one at a time and lets the
//! server hear the others before it is done: the hundred that came with it stand in line meanwhile.

use std::sync::{Arc, Mutex, PoisonError};
use std::thread::available_parallelism;
use std::time::{Duration, Instant};

use super::client::Client;
use super::crowd::{Crowd, Room};
use super::gate::{Gate, Turn};

/// What the server has to share out.
pub struct Fair {
    /// Requests taken in.
    pub taken: Arc<Crowd>,
    /// Turns at computing.
    pub computing: Arc<Gate>,
    /// Turns at everything else.
    pub other: Arc<Gate>,
    /// Answers that are written as their clients read them.
    pub streamed: Arc<Gate>,
    light: Arc<Gate>,
    company: Mutex<Company>,
}

/// Requests taken in at a time; more are told to come back.
pub const MOST_TAKEN: usize = 512;
/// Of these, a client with fewer is never told to.
const KEPT: usize = MOST_TAKEN / 8;
const OTHER: usize = 16;
const STREAMED: usize = 32;
/// Turns of one client at what waits.
const OF_WAITING: usize = 8;
/// How long a client counts as one of those who ask.
const PRESENT: Duration = Duration::from_millis(100);

/// Who asked last, and until when there are others.
struct Company {
    last: Option<Client>,
    until: Option<Instant>,
}

impl Fair {
    /// With all turns to give.
    pub fn new() -> Fair {
        let cores = cores();
        Fair {
            taken: Crowd::new(Room { most: MOST_TAKEN, each: usize::MAX, kept: KEPT }),
            computing: Gate::new(computing(cores), cores.max(2)),
            other: Gate::new(OTHER, OF_WAITING),
            streamed: Gate::new(STREAMED, OF_WAITING),
            light: Gate::new(usize::MAX, 1),
            company: Mutex::new(Company { last: None, until: None }),
        }
    }

    /// Threads for all of this and for what the server does by itself. More would each keep a stack and an arena, and a
    /// busy machine makes as many as it may.
    pub fn threads() -> usize {
        computing(cores()) + OTHER + STREAMED + 8
    }

    /// A client's turn at something light; none is needed while it is alone.
    pub async fn light(&self, client: &Client) -> Option<Turn> {
        if !self.in_company(client) {
            return None;
        }
        let turn = self.light.enter(client).await;
        tokio::task::yield_now().await;
        Some(turn)
    }

    /// How many wait for a turn.
    pub fn waiting(&self) -> usize {
        [&self.computing, &self.other, &self.streamed, &self.light].map(|gate| gate.waiting()).iter().sum()
    }

    /// Whether others than this client have asked a moment ago.
    fn in_company(&self, client: &Client) -> bool {
        let mut company = self.company.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        if company.last.as_ref() != Some(client) {
            let first = company.last.replace(client.clone()).is_none();
            company.until = (!first).then(|| now + PRESENT);
        }
        company.until.is_some_and(|until| now < until)
    }
}

fn cores() -> usize {
    available_parallelism().map_or(1, |n| n.get())
}

fn computing(cores: usize) -> usize {
    (4 * cores).max(16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn one_alone_takes_no_turn_and_one_of_several_waits_behind_its_own() {
        let fair = Fair::new();
        let (ann, bob) = (Client::at([10, 0, 0, 1].into()), Client::at([10, 0, 0, 2].into()));
        for _ in 0..3 {
            assert!(fair.light(&ann).await.is_none());
        }
        let first = fair.light(&bob).await.expect("ann was here a moment ago");
        assert!(fair.light(&ann).await.is_some());
        let (second, other) = (fair.light(&bob), fair.light(&ann));
        tokio::pin!(second);
        assert!(other.await.is_some());
        tokio::select! {
            biased;
            _ = &mut second => panic!("bob has one at a time"),
            () = std::future::ready(()) => {}
        }
        assert_eq!(fair.waiting(), 1);
        drop(first);
        assert!(second.await.is_some());
    }
}
