//! Worlds that are watched: what happens in one, told to whoever looks on.
//!
//! A world that nobody watches pays a look at a flag for each step. From the first watcher on, what happens is kept in a ring,
//! numbered from 1, so that who lost the connection goes on where it was; who falls behind misses the oldest. The ring goes when
//! nobody has watched for a while. What is told is what whoever sees the world may see: its counter, actions,
//! outcomes and what was observed, never latents that it hides.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::sync::watch as channel;

use super::state::lock;
use crate::task::Split;
use crate::trajectory::{End, Track, Trajectory};
use crate::world::Latents;

/// Events kept of a watched world.
pub const KEPT_EVENTS: usize = 64;
/// Sampled body states kept of it, 12 bytes each; the latest event is kept whatever it holds.
pub const KEPT_STATES: usize = 16_000;
/// Most sampled body states of a film; of a longer one every second, third, ... sample is left.
pub const FILM_STATES: usize = 2_000;

/// How long it is kept for watchers whose connection broke.
const PATIENCE: Duration = Duration::from_secs(15);

/// Something that happened in a world.
#[derive(Debug)]
pub struct Happened {
    pub number: u64,
    /// Valid attempts in the world after it.
    pub interactions: u64,
    pub what: What,
}

/// What happened.
#[derive(Debug)]
pub enum What {
    /// An episode began.
    Reset { task: String, split: Split },
    /// An action was carried out, or could not be placed.
    Step { task: String, action: Vec<f64>, brought: Brought },
    /// Actions were tried outside the episode; `film` is of the last one that was asked for with its samples.
    Attempts { task: String, tried: u64, valid: u64, solved: u64, film: Option<(Vec<f64>, Film)> },
    /// A simulation has other latents.
    Latents(Latents),
    /// The world is forgotten; nothing more will happen.
    Gone,
}

/// What an action brought.
#[derive(Debug)]
pub enum Brought {
    /// It could not be placed, and why.
    Refused(String),
    Done {
        solved: bool,
        steps: u32,
        end: End,
        film: Option<Film>,
    },
}

/// What is drawn of a trajectory.
#[derive(Clone, Debug)]
pub struct Film {
    /// s
    pub t: Vec<f32>,
    pub bodies: Vec<Way>,
}

/// Where a body was, a state for each time.
#[derive(Clone, Debug)]
pub struct Way {
    pub name: String,
    /// m
    pub x: Vec<f32>,
    /// m, up
    pub y: Vec<f32>,
    /// rad, counter-clockwise
    pub angle: Vec<f32>,
}

/// Where a world tells what happens in it.
#[derive(Default)]
pub struct Lookout {
    /// Whether anybody is to be told.
    on: AtomicBool,
    feed: Mutex<Option<Arc<Feed>>>,
}

/// What happened lately in a world, and who watches it.
struct Feed {
    ring: Mutex<Ring>,
    changed: channel::Sender<u64>,
    watchers: AtomicU64,
    /// When a sweep first found nobody watching.
    left: Mutex<Option<Duration>>,
}

#[derive(Default)]
struct Ring {
    /// Number of the latest event.
    last: u64,
    events: VecDeque<Arc<Happened>>,
    states: usize,
    gone: bool,
}

/// Events of a world from some point on. It does not keep the world from idling out.
pub struct WorldWatcher {
    feed: Arc<Feed>,
    seen: u64,
    changed: channel::Receiver<u64>,
}

impl Lookout {
    /// Whether somebody watches.
    pub fn is_on(&self) -> bool {
        self.on.load(Ordering::Relaxed)
    }

    /// Tells those who watch; `what` is asked only if there are any.
    pub fn tell(&self, interactions: u64, what: impl FnOnce() -> What) {
        if !self.is_on() {
            return;
        }
        if let Some(feed) = &*lock(&self.feed) {
            feed.push(interactions, what());
        }
    }

    /// Events after number `after`. A number that was not given out yet is of another watch: then all that are kept.
    pub fn watch(&self, after: u64) -> WorldWatcher {
        let mut feed = lock(&self.feed);
        let feed = feed.get_or_insert_with(Feed::new).clone();
        feed.watchers.fetch_add(1, Ordering::SeqCst);
        *lock(&feed.left) = None;
        self.on.store(true, Ordering::SeqCst);
        let seen = if after > lock(&feed.ring).last { 0 } else { after };
        let changed = feed.changed.subscribe();
        WorldWatcher { feed, seen, changed }
    }

    /// Lets go of what was kept once nobody has watched for a while.
    pub fn sweep(&self, now: Duration) {
        if !self.is_on() {
            return;
        }
        let mut feed = lock(&self.feed);
        let forsaken = |f: &Arc<Feed>| {
            let mut left = lock(&f.left);
            if f.watchers.load(Ordering::SeqCst) > 0 {
                *left = None;
                return false;
            }
            now.saturating_sub(*left.get_or_insert(now)) >= PATIENCE
        };
        if feed.as_ref().is_some_and(forsaken) {
            self.on.store(false, Ordering::SeqCst);
            *feed = None;
        }
    }

    /// Events kept, and the sampled body states in them.
    #[cfg(test)]
    pub fn kept(&self) -> (usize, usize) {
        let feed = lock(&self.feed);
        feed.as_ref().map_or((0, 0), |f| {
            let ring = lock(&f.ring);
            (ring.events.len(), ring.states)
        })
    }
}

impl Feed {
    fn new() -> Arc<Feed> {
        Arc::new(Feed {
            ring: Mutex::default(),
            changed: channel::Sender::new(0),
            watchers: AtomicU64::new(0),
            left: Mutex::default(),
        })
    }

    fn push(&self, interactions: u64, what: What) {
        let mut ring = lock(&self.ring);
        ring.last += 1;
        ring.gone = matches!(what, What::Gone);
        let event = Arc::new(Happened { number: ring.last, interactions, what });
        ring.states += event.states();
        ring.events.push_back(event);
        while ring.events.len() > KEPT_EVENTS || (ring.states > KEPT_STATES && ring.events.len() > 1) {
            let old = ring.events.pop_front();
            ring.states -= old.map_or(0, |e| e.states());
        }
        self.changed.send_replace(ring.last);
    }
}

impl Happened {
    /// Sampled body states that it holds.
    pub fn states(&self) -> usize {
        match &self.what {
            What::Step { brought: Brought::Done { film: Some(film), .. }, .. }
            | What::Attempts { film: Some((_, film)), .. } => film.t.len() * film.bodies.len(),
            _ => 0,
        }
    }
}

impl Film {
    /// Of a trajectory, with so many samples as an eye can follow, the last among them.
    pub fn of(trajectory: &Trajectory) -> Film {
        let n = trajectory.times.len();
        let every = (n * trajectory.bodies.len()).div_ceil(FILM_STATES).max(1);
        let thin = |values: &[f64]| -> Vec<f32> {
            let shown = values.iter().enumerate().filter(|(i, _)| i % every == 0 || i + 1 == n);
            shown.map(|(_, v)| *v as f32).collect()
        };
        let way =
            |b: &Track| Way { name: b.name.clone(), x: thin(&b.x), y: thin(&b.y), angle: thin(&b.angle) };
        Film { t: thin(&trajectory.times), bodies: trajectory.bodies.iter().map(way).collect() }
    }
}

impl WorldWatcher {
    /// Films that are kept, the oldest first.
    #[cfg(test)]
    pub fn films(&self) -> Vec<Film> {
        let film = |e: &Arc<Happened>| match &e.what {
            What::Step { brought: Brought::Done { film: Some(film), .. }, .. } => Some(film.clone()),
            What::Attempts { film: Some((_, film)), .. } => Some(film.clone()),
            _ => None,
        };
        lock(&self.feed.ring).events.iter().filter_map(film).collect()
    }

    /// Waits for the next event; `None` after the last.
    pub async fn next(&mut self) -> Option<Arc<Happened>> {
        loop {
            self.changed.borrow_and_update();
            {
                let ring = lock(&self.feed.ring);
                if let Some(event) = ring.events.iter().find(|e| e.number > self.seen) {
                    self.seen = event.number;
                    return Some(event.clone());
                }
                if ring.gone {
                    return None;
                }
            }
            self.changed.changed().await.ok()?;
        }
    }
}

impl Drop for WorldWatcher {
    fn drop(&mut self) {
        self.feed.watchers.fetch_sub(1, Ordering::SeqCst);
    }
}
