//! Watching a job's events from any point on.

use std::sync::Arc;

use tokio::sync::watch;

use super::record::{Job, number, unknown};
use super::state::RunnerState;
use crate::error::Result;
use crate::store::JobRow;

/// Events of a job from some event on.
pub struct Watcher {
    shared: Arc<RunnerState>,
    number: i64,
    last_id: u64,
    changed: watch::Receiver<u64>,
    /// A job that is no longer in memory: only its final state is known.
    ended: Option<Job>,
}

impl Watcher {
    /// Events after number `after`. A number beyond the last event is from before a restart, which keeps no events: then all events.
    pub(super) fn new(shared: Arc<RunnerState>, id: &str, after: u64) -> Result<Watcher> {
        let number = number(id)?;
        let from = |row: &JobRow| if after > row.events { 0 } else { after };
        if let Some(live) = shared.state().jobs.get(&number) {
            let (changed, last_id) = (live.changed.subscribe(), from(&live.row));
            return Ok(Watcher { shared: shared.clone(), number, last_id, changed, ended: None });
        }
        let row = shared.store.job(number)?.ok_or_else(|| unknown(id))?;
        let (changed, last_id) = (watch::Sender::new(row.events).subscribe(), from(&row));
        Ok(Watcher { shared, number, last_id, changed, ended: Some(Job::of(row)) })
    }

    /// Waits for the next event: its id and the job at that time. `None` after the last.
    pub async fn next(&mut self) -> Option<(u64, Job)> {
        loop {
            if let Some(job) = self.ended.take() {
                let last_id = std::mem::replace(&mut self.last_id, job.row.events);
                return (job.row.events > last_id).then_some((job.row.events, job));
            }
            self.changed.borrow_and_update();
            {
                let state = self.shared.state();
                let Some(live) = state.jobs.get(&self.number) else { break };
                if let Some(event) = live.events.iter().find(|e| e.id > self.last_id) {
                    self.last_id = event.id;
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

    /// The final event of a job that is no longer in memory.
    fn last(&mut self) -> Option<(u64, Job)> {
        let row = self.shared.store.job(self.number).ok()??;
        let news = row.state.ended() && row.events > self.last_id;
        self.last_id = row.events;
        news.then(|| (row.events, Job::of(row)))
    }

    /// Whether no further events will come.
    pub fn exhausted(&self) -> bool {
        let is_exhausted = |row: &JobRow| row.state.ended() && row.events <= self.last_id;
        match &self.ended {
            Some(job) => is_exhausted(&job.row),
            None => self.shared.state().jobs.get(&self.number).is_none_or(|live| is_exhausted(&live.row)),
        }
    }
}
