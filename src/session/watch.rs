//! Event stream of a world.
//!
//! Without watchers a step costs one read of an atomic flag. With watchers, events are numbered from 1 and buffered in a ring,
//! so that a client can resume after a lost connection; slow clients miss the oldest events. The ring is dropped some time
//! after the last watcher has left. Events contain only what the world reveals: counter, actions, outcomes and observations,
//! never hidden latents.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::sync::watch as channel;

use crate::sync::lock;
use crate::task::Split;
use crate::trajectory::{Termination, Track, Trajectory};
use crate::world::Latents;

/// Events buffered per watched world.
pub const MAX_BUFFERED_EVENTS: usize = 64;
/// Sampled body states buffered per watched world, 12 bytes each; the latest event is always kept.
pub const MAX_BUFFERED_STATES: usize = 16_000;
/// Maximum number of sampled body states in a recording; longer ones keep every second, third, ... sample.
pub const MAX_RECORDING_STATES: usize = 2_000;

/// How long events are kept for reconnecting watchers.
const RECONNECT_GRACE: Duration = Duration::from_secs(15);

/// An event in a world.
#[derive(Debug)]
pub struct WorldEvent {
    pub number: u64,
    /// Valid attempts in the world after the event.
    pub interactions: u64,
    pub what: WorldEventKind,
}

/// Kind of an event, with its data.
#[derive(Debug)]
pub enum WorldEventKind {
    /// An episode started.
    Reset { task: String, split: Split },
    /// An action was attempted in the episode.
    Step { task: String, action: Vec<f64>, outcome: StepOutcome },
    /// Actions were attempted outside the episode; `film` is the action and recording of the last one with samples.
    Attempts { task: String, tried: u64, valid: u64, solved: u64, film: Option<(Vec<f64>, Recording)> },
    /// A simulation's latents were set.
    Latents(Latents),
    /// The world was deleted; the last event.
    Deleted,
}

/// Outcome of a step.
#[derive(Debug)]
pub enum StepOutcome {
    /// The action could not be placed, for this reason.
    Refused(String),
    Done {
        solved: bool,
        steps: u32,
        end: Termination,
        film: Option<Recording>,
    },
}

/// A trajectory reduced for drawing: single precision, limited number of samples.
#[derive(Clone, Debug)]
pub struct Recording {
    /// s
    pub t: Vec<f32>,
    pub bodies: Vec<BodyPath>,
}

/// Poses of a body, one per time.
#[derive(Clone, Debug)]
pub struct BodyPath {
    pub name: String,
    /// m
    pub x: Vec<f32>,
    /// m, up
    pub y: Vec<f32>,
    /// rad, counter-clockwise
    pub angle: Vec<f32>,
}

/// Publishes a world's events.
#[derive(Default)]
pub struct EventBus {
    /// Whether there may be watchers.
    active: AtomicBool,
    feed: Mutex<Option<Arc<EventFeed>>>,
}

/// Recent events of a world and its watchers.
struct EventFeed {
    ring: Mutex<EventRing>,
    changed: channel::Sender<u64>,
    watchers: AtomicU64,
    /// When a sweep first found no watchers.
    left: Mutex<Option<Duration>>,
}

#[derive(Default)]
struct EventRing {
    /// Number of the latest event.
    last: u64,
    events: VecDeque<Arc<WorldEvent>>,
    states: usize,
    gone: bool,
}

/// A subscription to a world's events. It does not keep the world from expiring.
pub struct WorldWatcher {
    feed: Arc<EventFeed>,
    seen: u64,
    changed: channel::Receiver<u64>,
}

impl EventBus {
    /// Whether events are published.
    pub fn is_active(&self) -> bool {
        self.active.load(Ordering::Relaxed)
    }

    /// Publishes an event; `what` is only evaluated if there are watchers.
    pub fn publish(&self, interactions: u64, what: impl FnOnce() -> WorldEventKind) {
        if !self.is_active() {
            return;
        }
        if let Some(feed) = &*lock(&self.feed) {
            feed.push(interactions, what());
        }
    }

    /// Subscribes to events after number `after`; if that number was never issued, to all buffered events.
    pub fn watch(&self, after: u64) -> WorldWatcher {
        let mut feed = lock(&self.feed);
        let feed = feed.get_or_insert_with(EventFeed::new).clone();
        feed.watchers.fetch_add(1, Ordering::SeqCst);
        *lock(&feed.left) = None;
        self.active.store(true, Ordering::SeqCst);
        let seen = if after > lock(&feed.ring).last { 0 } else { after };
        let changed = feed.changed.subscribe();
        WorldWatcher { feed, seen, changed }
    }

    /// Drops buffered events some time after the last watcher has left.
    pub fn sweep(&self, now: Duration) {
        if !self.is_active() {
            return;
        }
        let mut feed = lock(&self.feed);
        let forsaken = |f: &Arc<EventFeed>| {
            let mut left = lock(&f.left);
            if f.watchers.load(Ordering::SeqCst) > 0 {
                *left = None;
                return false;
            }
            now.saturating_sub(*left.get_or_insert(now)) >= RECONNECT_GRACE
        };
        if feed.as_ref().is_some_and(forsaken) {
            self.active.store(false, Ordering::SeqCst);
            *feed = None;
        }
    }

    /// Number of buffered events, and of sampled body states in them.
    #[cfg(test)]
    pub fn buffered(&self) -> (usize, usize) {
        let feed = lock(&self.feed);
        feed.as_ref().map_or((0, 0), |f| {
            let ring = lock(&f.ring);
            (ring.events.len(), ring.states)
        })
    }
}

impl EventFeed {
    fn new() -> Arc<EventFeed> {
        Arc::new(EventFeed {
            ring: Mutex::default(),
            changed: channel::Sender::new(0),
            watchers: AtomicU64::new(0),
            left: Mutex::default(),
        })
    }

    fn push(&self, interactions: u64, what: WorldEventKind) {
        let mut ring = lock(&self.ring);
        ring.last += 1;
        ring.gone = matches!(what, WorldEventKind::Deleted);
        let event = Arc::new(WorldEvent { number: ring.last, interactions, what });
        ring.states += event.states();
        ring.events.push_back(event);
        while ring.events.len() > MAX_BUFFERED_EVENTS
            || (ring.states > MAX_BUFFERED_STATES && ring.events.len() > 1)
        {
            let old = ring.events.pop_front();
            ring.states -= old.map_or(0, |e| e.states());
        }
        self.changed.send_replace(ring.last);
    }
}

impl WorldEvent {
    /// Number of sampled body states.
    pub fn states(&self) -> usize {
        match &self.what {
            WorldEventKind::Step { outcome: StepOutcome::Done { film: Some(film), .. }, .. }
            | WorldEventKind::Attempts { film: Some((_, film)), .. } => film.t.len() * film.bodies.len(),
            _ => 0,
        }
    }
}

impl Recording {
    /// Thins a trajectory to at most about `FILM_STATES` body states, keeping the last sample.
    pub fn of(trajectory: &Trajectory) -> Recording {
        let n = trajectory.times.len();
        let every = (n * trajectory.bodies.len()).div_ceil(MAX_RECORDING_STATES).max(1);
        let thin = |values: &[f64]| -> Vec<f32> {
            let shown = values.iter().enumerate().filter(|(i, _)| i % every == 0 || i + 1 == n);
            shown.map(|(_, v)| *v as f32).collect()
        };
        let way = |b: &Track| BodyPath {
            name: b.name.clone(),
            x: thin(&b.x),
            y: thin(&b.y),
            angle: thin(&b.angle),
        };
        Recording { t: thin(&trajectory.times), bodies: trajectory.bodies.iter().map(way).collect() }
    }
}

impl WorldWatcher {
    /// Buffered recordings, oldest first.
    #[cfg(test)]
    pub fn recordings(&self) -> Vec<Recording> {
        let film = |e: &Arc<WorldEvent>| match &e.what {
            WorldEventKind::Step { outcome: StepOutcome::Done { film: Some(film), .. }, .. } => {
                Some(film.clone())
            }
            WorldEventKind::Attempts { film: Some((_, film)), .. } => Some(film.clone()),
            _ => None,
        };
        lock(&self.feed.ring).events.iter().filter_map(film).collect()
    }

    /// Waits for the next event; `None` after the last one.
    pub async fn next(&mut self) -> Option<Arc<WorldEvent>> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::Unlimited;
    use crate::session::{Action, Catalogue, Reset, RolloutRequest, World, WorldConfig, WorldKind};

    fn world(kind: WorldKind) -> World {
        let tasks = Catalogue::new().named("bowling:000").unwrap();
        World::new(WorldConfig::new(tasks, kind)).unwrap()
    }

    /// Events available now.
    fn available_events(watcher: &mut WorldWatcher) -> Vec<Arc<WorldEvent>> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let mut all = Vec::new();
        let soon = std::time::Duration::from_millis(1);
        let next = |w: &mut WorldWatcher| {
            runtime.block_on(async { tokio::time::timeout(soon, w.next()).await.ok().flatten() })
        };
        while let Some(event) = next(watcher) {
            all.push(event);
        }
        all
    }

    fn buffered(world: &World) -> usize {
        world.events().buffered().0
    }

    #[test]
    fn watchers_receive_steps_with_recordings() {
        for kind in [WorldKind::Sim, WorldKind::Real] {
            let world = world(kind);
            world.reset(&Reset::default()).unwrap();
            assert_eq!(buffered(&world), 0, "no watchers");
            let mut watcher = world.watch(0);
            world.reset(&Reset::default()).unwrap();
            let index = |i| Action::Index(i);
            let tried: Vec<_> = (0..40).map(|i| world.step(&index(i), None, &Unlimited)).collect();
            let valid = tried.iter().flatten().filter(|s| s.invalid.is_none()).count();
            assert_eq!(valid, 1);
            let events = available_events(&mut watcher);
            assert!(matches!(&events[0].what, WorldEventKind::Reset { task, .. } if task == "bowling:000"));
            let last = events.last().unwrap();
            let WorldEventKind::Step { action, outcome: StepOutcome::Done { film: Some(film), .. }, .. } =
                &last.what
            else {
                panic!("{last:?}")
            };
            assert_eq!((action.len(), last.interactions), (3, 1));
            assert!(film.t.len() > 10 && film.bodies.iter().all(|b| b.x.len() == film.t.len()));
            let refused = |e: &WorldEvent| {
                matches!(&e.what, WorldEventKind::Step { outcome: StepOutcome::Refused(_), .. })
            };
            assert_eq!(events.iter().filter(|e| refused(e)).count() + 2, events.len());
        }
    }

    #[test]
    fn watchers_resume_and_miss_only_the_oldest_events() {
        let world = world(WorldKind::Sim);
        let mut watcher = world.watch(0);
        (0..3).for_each(|_| drop(world.reset(&Reset::default()).unwrap()));
        let numbers = |w: &mut WorldWatcher| available_events(w).iter().map(|e| e.number).collect::<Vec<_>>();
        assert_eq!(numbers(&mut watcher), [1, 2, 3]);
        drop(watcher);
        world.reset(&Reset::default()).unwrap();
        assert_eq!(numbers(&mut world.watch(2)), [3, 4], "also what happened in between");
        assert_eq!(numbers(&mut world.watch(99)), [1, 2, 3, 4], "a number of another watch");
        let mut slow = world.watch(0);
        (0..2 * MAX_BUFFERED_EVENTS).for_each(|_| drop(world.reset(&Reset::default()).unwrap()));
        let (all, last) = (numbers(&mut slow), 4 + 2 * MAX_BUFFERED_EVENTS as u64);
        assert_eq!((all.len(), all.last()), (MAX_BUFFERED_EVENTS, Some(&last)));
    }

    #[test]
    fn recordings_are_bounded() {
        let world = world(WorldKind::Sim);
        let mut watcher = world.watch(0);
        let actions: Vec<Action> = (0..200).map(Action::Index).collect();
        let one = |action: &Action| RolloutRequest {
            actions: vec![action.clone()],
            task: None,
            trajectories: true,
            stop: false,
            interventions: Vec::new(),
        };
        actions.iter().for_each(|a| drop(world.rollout(&one(a), &Unlimited).unwrap()));
        let states = world.events().buffered().1;
        assert!(states > 0 && states <= MAX_BUFFERED_STATES, "{states}");
        assert!(available_events(&mut watcher).iter().all(|e| e.states() <= MAX_RECORDING_STATES + 3));
    }

    #[test]
    fn drops_events_without_watchers_and_announces_deletion() {
        let world = world(WorldKind::Sim);
        let watcher = world.watch(0);
        world.reset(&Reset::default()).unwrap();
        let sweep = |s: u64| world.events().sweep(Duration::from_secs(s));
        (0..99).for_each(sweep);
        assert_eq!(buffered(&world), 1, "it is watched");
        drop(watcher);
        (100..110).for_each(sweep);
        assert_eq!(buffered(&world), 1, "the connection may have broken");
        sweep(120);
        assert_eq!(buffered(&world), 0);
        assert!(!world.events().is_active());
        let mut watcher = world.watch(0);
        drop(world);
        assert!(
            matches!(available_events(&mut watcher)[..], [ref e] if matches!(e.what, WorldEventKind::Deleted))
        );
    }
}
