//! A job in memory: one that has not ended, or ended recently; with its work and its events.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use tokio::sync::watch as channel;

use super::eta::EtaEstimator;
use super::record::{Figure, Job};
use super::work::Work;
use crate::store::{JobMetadata, JobRow, JobState};

/// A job in memory.
pub struct ActiveJob {
    pub row: JobRow,
    /// Client for fair scheduling: the owner, or the peer of an anonymous request.
    pub client: String,
    pub work: Option<Work>,
    /// Set to cancel the job.
    pub cancel: Arc<AtomicBool>,
    /// Results arrived while it ran: it is queued again instead of waiting.
    pub results_complete: bool,
    /// Whether memory was scarce while it ran.
    pub scarce_memory: bool,
    pub eta: EtaEstimator,
    pub events: VecDeque<JobEvent>,
    /// Reported by its work since the last event.
    pub figures: Vec<Figure>,
    pub changed: channel::Sender<u64>,
    /// Size of its row as JSON, bytes; set when it has ended.
    pub size: usize,
}

/// Events kept of a job; a watcher further behind misses the oldest.
pub const MAX_EVENTS_PER_JOB: usize = 1024;

/// State of a job at the time of an event.
pub struct JobEvent {
    pub id: u64,
    pub state: JobState,
    started: Option<u64>,
    stage: String,
    done: u64,
    total: u64,
    left: Option<f64>,
    figures: Vec<Figure>,
}

impl ActiveJob {
    /// A job queued by a client at `place`, or loaded from the store.
    pub fn new(row: JobRow, place: &str, work: Option<Work>) -> ActiveJob {
        ActiveJob {
            client: row.owner.clone().unwrap_or_else(|| place.to_string()),
            events: VecDeque::from([JobEvent::of(&row, None, Vec::new())]),
            changed: channel::Sender::new(row.events),
            cancel: Arc::default(),
            figures: Vec::new(),
            results_complete: false,
            scarce_memory: false,
            eta: EtaEstimator::default(),
            size: 0,
            work,
            row,
        }
    }

    /// Adds an event and notifies the watchers; `left` is the estimated remaining time, s.
    pub fn emit(&mut self, left: Option<f64>) {
        self.row.events += 1;
        if self.events.len() == MAX_EVENTS_PER_JOB {
            self.events.pop_front();
        }
        self.events.push_back(JobEvent::of(&self.row, left, std::mem::take(&mut self.figures)));
        self.changed.send_replace(self.row.events);
    }

    /// As its owner sees it.
    pub fn job(&self, now: Duration) -> Job {
        let running = self.row.state == JobState::Running;
        let left = self.eta.seconds_left(now, self.row.done, self.row.total).filter(|_| running);
        Job { left, ..Job::of(self.row.clone()) }
    }
}

impl JobEvent {
    fn of(row: &JobRow, left: Option<f64>, figures: Vec<Figure>) -> JobEvent {
        JobEvent {
            id: row.events,
            state: row.state,
            started: row.metadata.started,
            stage: row.stage.clone(),
            done: row.done,
            total: row.total,
            left,
            figures,
        }
    }

    /// The job at the time of this event.
    pub fn job(&self, now: &JobRow) -> Job {
        let ended = self.state.ended();
        let metadata = JobMetadata {
            started: self.started,
            ended: now.metadata.ended.filter(|_| ended),
            summary: now.metadata.summary.clone().filter(|_| ended),
            ..now.metadata.clone()
        };
        let row = JobRow {
            state: self.state,
            stage: self.stage.clone(),
            done: self.done,
            total: self.total,
            events: self.id,
            result: now.result.clone().filter(|_| ended),
            error: now.error.clone().filter(|_| ended),
            metadata,
            ..now.clone()
        };
        Job { left: self.left, figures: self.figures.clone(), ..Job::of(row) }
    }
}
