//! The jobs in memory, and which of the queued ones starts next.

use std::collections::{BTreeMap, VecDeque};

use super::active::ActiveJob;
use crate::store::JobState;

/// The jobs in memory.
#[derive(Default)]
pub struct JobQueue {
    /// Queued jobs in order of arrival; [`JobQueue::pop_next`] chooses the next.
    pub queue: VecDeque<i64>,
    /// Clients in the order of their last started job.
    recent_clients: VecDeque<String>,
    /// Jobs that have not ended, and recently ended ones, whose events can be watched.
    pub jobs: BTreeMap<i64, ActiveJob>,
}

/// When the queue is full, a client with fewer than this fraction of it may still queue: no client can lock out the others.
const RESERVED_QUEUE_DIVISOR: usize = 8;
/// Maximum clients remembered for round-robin scheduling.
const MAX_REMEMBERED_CLIENTS: usize = 256;

impl JobQueue {
    /// Number of queued jobs of a client.
    pub fn queued(&self, client: &str) -> usize {
        self.queue.iter().filter(|n| self.jobs.get(n).is_some_and(|l| l.client == client)).count()
    }

    /// Whether the queue is full for a client.
    pub fn is_full(&self, client: &str, most: usize) -> bool {
        let own = self.queued(client);
        self.queue.len() >= most && (own >= most / RESERVED_QUEUE_DIVISOR || self.queue.len() >= 2 * most)
    }

    /// Removes the oldest ended jobs from memory; they are stored, and only their events are lost.
    pub fn evict_ended(&mut self) {
        let ended = self.jobs.iter().rev().filter(|(_, l)| l.row.state.ended());
        let retained = ended.scan((0, 0), |(count, bytes), (number, live)| {
            (*count, *bytes) = (*count + 1, *bytes + live.size);
            Some((
                *number,
                *count == 1 || (*count <= MAX_ENDED_JOBS_IN_MEMORY && *bytes <= MAX_ENDED_JOB_BYTES),
            ))
        });
        let old: Vec<i64> = retained.filter(|(_, retained)| !retained).map(|(number, _)| number).collect();
        old.iter().for_each(|number| drop(self.jobs.remove(number)));
    }

    /// The next job that may start beside the running ones: the oldest one of the client with the fewest running jobs, and among
    /// those of the client whose last start is longest ago.
    pub fn pop_next(&mut self, running_limit: usize) -> Option<i64> {
        let mut running: BTreeMap<&str, usize> = BTreeMap::new();
        for live in self.jobs.values().filter(|l| l.row.state == JobState::Running) {
            *running.entry(&live.client).or_default() += 1;
        }
        let turn = |client: &str| {
            let last = self.recent_clients.iter().rposition(|c| c == client);
            (running.get(client).copied().unwrap_or(0), last)
        };
        let total: usize = running.values().sum();
        let first_limit = if running_limit == 0 { 0 } else { running_limit.max(MAX_RUNNING_CLIENTS) };
        let may_start = |own: usize| total < if own == 0 { first_limit } else { running_limit };
        let waiting = self.queue.iter().enumerate();
        // A queued job that is not in memory was cancelled.
        let turns = waiting.filter_map(|(at, number)| Some((turn(&self.jobs.get(number)?.client), at)));
        let (_, at) = turns.filter(|((own, _), _)| may_start(*own)).min()?;
        let number = self.queue.remove(at)?;
        let client = self.jobs.get(&number)?.client.clone();
        self.recent_clients.retain(|c| *c != client);
        self.recent_clients.push_back(client);
        // A client whose last start is that long ago counts as new.
        let many = self.recent_clients.len().saturating_sub(MAX_REMEMBERED_CLIENTS);
        self.recent_clients.drain(..many);
        Some(number)
    }
}

/// Maximum number of jobs that run at a time because their clients had none, unless [`RunnerConfig::running`] is larger.
const MAX_RUNNING_CLIENTS: usize = 16;
/// Maximum ended jobs kept in memory.
const MAX_ENDED_JOBS_IN_MEMORY: usize = 64;
/// Maximum size of ended jobs kept in memory, bytes as JSON; the latest is kept whatever its size.
const MAX_ENDED_JOB_BYTES: usize = 8 * 1024 * 1024;

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::store::Store;

    /// A queue of jobs; each letter is the client of one.
    fn queued(clients: &str) -> JobQueue {
        let store = Store::in_memory().unwrap();
        let mut state = JobQueue::default();
        for client in clients.chars() {
            let row = store.add_job("act", &json!({}), &json!(1), 0, None, &|_| None).unwrap();
            state.queue.push_back(row.number);
            state.jobs.insert(row.number, ActiveJob::new(row, &client.to_string(), None));
        }
        state
    }

    /// Clients of the jobs in the order in which they start, with this many workers.
    fn begun(mut state: JobQueue, workers: usize) -> String {
        let (mut running, mut order) = (VecDeque::new(), String::new());
        while let Some(number) = state.pop_next(workers) {
            let live = state.jobs.get_mut(&number).unwrap();
            live.row.state = JobState::Running;
            order += &live.client;
            running.push_back(number);
            if running.len() == workers {
                let ended = running.pop_front().unwrap();
                state.jobs.get_mut(&ended).unwrap().row.state = JobState::Succeeded;
            }
        }
        order
    }

    #[test]
    fn schedules_clients_round_robin() {
        assert_eq!(begun(queued("aaaaaa"), 2), "aaaaaa");
        assert_eq!(begun(queued("aaaaaabb"), 1), "ababaaaa");
        assert_eq!(begun(queued("aaaaaabbc"), 2), "abcabaaaa");
        let mut state = queued("aabb");
        assert_eq!(state.pop_next(9), Some(1), "the oldest of its client");
        state.jobs.get_mut(&1).unwrap().row.state = JobState::Running;
        assert_eq!(state.pop_next(9), Some(3), "who has one running waits for who has none");
        state.jobs.remove(&2);
        assert_eq!(
            (state.pop_next(9), state.pop_next(9)),
            (Some(4), None),
            "what is no longer at hand is left out"
        );
    }

    #[test]
    fn evicts_old_and_large_ended_jobs() {
        let ended = |count: usize, size: usize| {
            let mut state = queued(&"a".repeat(count));
            for live in state.jobs.values_mut() {
                (live.row.state, live.size) = (JobState::Succeeded, size);
            }
            state.jobs.get_mut(&1).unwrap().row.state = JobState::Waiting;
            state.evict_ended();
            (state.jobs.len(), *state.jobs.keys().nth(1).unwrap())
        };
        assert_eq!(ended(70, 1000), (65, 7), "64, and the one that has not ended");
        assert_eq!(ended(10, MAX_ENDED_JOB_BYTES / 4), (5, 7));
        assert_eq!(ended(10, 2 * MAX_ENDED_JOB_BYTES), (2, 10));
    }

    #[test]
    fn full_queue_reserves_places() {
        let full = queued(&"a".repeat(16));
        assert!(full.is_full("a", 16) && !full.is_full("b", 16) && !full.is_full("a", 17));
        let own = queued(&("a".repeat(14) + "bb"));
        assert!(own.is_full("b", 16), "it has its two");
        assert!(queued(&"a".repeat(32)).is_full("b", 16), "twice is the end of it");
        assert!(queued("a").is_full("b", 1), "a queue of one has nothing to keep");
    }
}
