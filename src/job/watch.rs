//! A job's events, to be watched from anywhere on.

use std::sync::Arc;

use tokio::sync::watch;

use super::record::{Job, number, unknown};
use super::shared::Shared;
use crate::error::Result;
use crate::store::JobRow;

/// Events of a job from some point on.
pub struct Watcher {
    shared: Arc<Shared>,
    number: i64,
    seen: u64,
    changed: watch::Receiver<u64>,
    /// An ended job of which nothing but the end is known.
    ended: Option<Job>,
}

impl Watcher {
    /// Events after number `after`. A number that was not given out yet is of before a restart, which keeps no
    /// progress: then all there are.
    pub(super) fn new(shared: Arc<Shared>, id: &str, after: u64) -> Result<Watcher> {
        let number = number(id)?;
        let from = |row: &JobRow| if after > row.events { 0 } else { after };
        if let Some(live) = shared.state().live.get(&number) {
            let (changed, seen) = (live.changed.subscribe(), from(&live.row));
            return Ok(Watcher { shared: shared.clone(), number, seen, changed, ended: None });
        }
        let row = shared.store.job(number)?.ok_or_else(|| unknown(id))?;
        let (changed, seen) = (watch::Sender::new(row.events).subscribe(), from(&row));
        Ok(Watcher { shared, number, seen, changed, ended: Some(Job::of(row)) })
    }

    /// Waits for the next event: its id and the job as it was then. `None` after the last.
    pub async fn next(&mut self) -> Option<(u64, Job)> {
        loop {
            if let Some(job) = self.ended.take() {
                let seen = std::mem::replace(&mut self.seen, job.row.events);
                return (job.row.events > seen).then_some((job.row.events, job));
            }
            self.changed.borrow_and_update();
            {
                let state = self.shared.state();
                let Some(live) = state.live.get(&self.number) else { break };
                if let Some(event) = live.events.iter().find(|e| e.id > self.seen) {
                    self.seen = event.id;
                    return Some((event.id, event.job(&live.row)));
                }
                if live.row.state.ended() {
                    return None;
                }
            }
            if self.changed.changed().await.is_err() {
                break;
            }
        }
        self.last()
    }

    /// How a job ended that is no longer at hand.
    fn last(&mut self) -> Option<(u64, Job)> {
        let row = self.shared.store.job(self.number).ok()??;
        let news = row.state.ended() && row.events > self.seen;
        self.seen = row.events;
        news.then(|| (row.events, Job::of(row)))
    }

    /// Whether every event the job will ever have was seen before.
    pub fn exhausted(&self) -> bool {
        let seen = |row: &JobRow| row.state.ended() && row.events <= self.seen;
        match &self.ended {
            Some(job) => seen(&job.row),
            None => self.shared.state().live.get(&self.number).is_none_or(|live| seen(&live.row)),
        }
    }
}
