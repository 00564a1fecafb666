//! A job that has not ended, or ended a little while ago: with its work and its events.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use tokio::sync::watch as channel;

use super::pace::Pace;
use super::record::{Figure, Job};
use super::work::Work;
use crate::store::{JobRow, JobState};

/// A job at hand.
pub struct Live {
    pub row: JobRow,
    /// Whose turn it takes: its owner's, or of whoever asked for it where nobody is known.
    pub client: String,
    pub work: Option<Work>,
    /// Set by its owner.
    pub cancel: Arc<AtomicBool>,
    /// Answers came while it ran: should it wait, it need not.
    pub again: bool,
    pub pace: Pace,
    pub events: VecDeque<Event>,
    /// Told by its work since the last event.
    pub figures: Vec<Figure>,
    pub changed: channel::Sender<u64>,
    /// Of its row as JSON, bytes; known once it has ended.
    pub size: usize,
}

/// Events kept of a running job; a watcher further behind misses the oldest.
pub const KEPT_EVENTS: usize = 1024;

/// A job as it was at some moment.
pub struct Event {
    pub id: u64,
    pub state: JobState,
    stage: String,
    done: u64,
    total: u64,
    left: Option<f64>,
    figures: Vec<Figure>,
}

impl Live {
    /// Newly queued by somebody at `place`, or found in the store.
    pub fn new(row: JobRow, place: &str, work: Option<Work>) -> Live {
        Live {
            client: row.owner.clone().unwrap_or_else(|| place.to_string()),
            events: VecDeque::from([Event::of(&row, None, Vec::new())]),
            changed: channel::Sender::new(row.events),
            cancel: Arc::default(),
            figures: Vec::new(),
            again: false,
            pace: Pace::default(),
            size: 0,
            work,
            row,
        }
    }

    /// Tells whoever watches; `left` is how long it will still take, s.
    pub fn emit(&mut self, left: Option<f64>) {
        self.row.events += 1;
        if self.events.len() == KEPT_EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(Event::of(&self.row, left, std::mem::take(&mut self.figures)));
        self.changed.send_replace(self.row.events);
    }

    /// As its owner sees it.
    pub fn job(&self, now: Duration) -> Job {
        let running = self.row.state == JobState::Running;
        let left = self.pace.left(now, self.row.done, self.row.total).filter(|_| running);
        Job { left, ..Job::of(self.row.clone()) }
    }
}

impl Event {
    fn of(row: &JobRow, left: Option<f64>, figures: Vec<Figure>) -> Event {
        let (stage, done, total) = (row.stage.clone(), row.done, row.total);
        Event { id: row.events, state: row.state, stage, done, total, left, figures }
    }

    /// The job as it was at this event.
    pub fn job(&self, now: &JobRow) -> Job {
        let ended = self.state.ended();
        let row = JobRow {
            state: self.state,
            stage: self.stage.clone(),
            done: self.done,
            total: self.total,
            events: self.id,
            result: now.result.clone().filter(|_| ended),
            error: now.error.clone().filter(|_| ended),
            ..now.clone()
        };
        Job { left: self.left, figures: self.figures.clone(), ..Job::of(row) }
    }
}
