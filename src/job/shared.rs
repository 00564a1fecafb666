//! What a runner and its workers share: the queue, the jobs at hand, and what becomes of them.

use std::collections::{BTreeMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::live::Live;
use super::pace::Pace;
use super::record::{Figure, id};
use super::work::{Context, Outcome, Recipes, Stage, Work};
use crate::error::{Error, Result};
use crate::store::{JobRow, JobState, Level, Store};

/// Limits of a runner, and how it words failures.
#[derive(Clone, Copy)]
pub struct RunnerConfig {
    /// Jobs running at a time.
    pub workers: usize,
    /// Most jobs queued.
    pub queue: usize,
    /// Threads a running job computes with; 0 for as many as rayon's own pool has.
    pub threads: usize,
    /// Longest a job may compute from when it is begun until it ends or waits.
    pub most: Option<Duration>,
    /// What a job's owner is told about an error.
    pub explain: fn(&Error) -> Value,
}

/// Hears of a job that has ended.
pub type Told = Box<dyn Fn(&JobRow) + Send + Sync>;

/// Starts without progress after which a job fails.
pub const MOST_STARTS: u32 = 5;

/// Everything but the workers' handles.
pub struct Shared {
    pub store: Arc<Store>,
    pub recipes: Recipes,
    pub config: RunnerConfig,
    pub told: Told,
    pub state: Mutex<State>,
    /// Told when there is work or the runner stops.
    pub wake: Condvar,
    pub stopping: AtomicBool,
    /// Time is counted from here.
    pub origin: Instant,
}

/// The jobs.
#[derive(Default)]
pub struct State {
    /// In the order in which they came; [`State::pop`] says which is next.
    pub queue: VecDeque<i64>,
    /// Clients whose jobs were begun, the latest last.
    begun: VecDeque<String>,
    /// Jobs that have not ended, and recently ended ones that may be watched.
    pub live: BTreeMap<i64, Live>,
}

/// Of a full queue, a client with fewer jobs than one in so many of it may have one more: who fills it keeps nobody out.
const KEPT: usize = 8;
/// Clients remembered.
const MOST_BEGUN: usize = 256;

impl State {
    /// Whether nothing more of this client's is queued, of a queue of so many.
    pub fn is_full(&self, client: &str, most: usize) -> bool {
        let own = self.queue.iter().filter(|n| self.live.get(n).is_some_and(|l| l.client == client)).count();
        self.queue.len() >= most && (own >= most / KEPT || self.queue.len() >= 2 * most)
    }

    /// Once stored, an ended job is kept here only for its events; forgets the oldest.
    fn forget(&mut self) {
        let ended = self.live.iter().rev().filter(|(_, l)| l.row.state.ended());
        let kept = ended.scan((0, 0), |(count, bytes), (number, live)| {
            (*count, *bytes) = (*count + 1, *bytes + live.size);
            Some((*number, *count == 1 || (*count <= KEPT_JOBS && *bytes <= KEPT_BYTES)))
        });
        let old: Vec<i64> = kept.filter(|(_, kept)| !kept).map(|(number, _)| number).collect();
        old.iter().for_each(|number| drop(self.live.remove(number)));
    }

    /// The next job: of the clients of whom one waits, the one with the fewest running, and of those the one whose turn is
    /// longest ago; its oldest.
    fn pop(&mut self) -> Option<i64> {
        let mut running: BTreeMap<&str, usize> = BTreeMap::new();
        for live in self.live.values().filter(|l| l.row.state == JobState::Running) {
            *running.entry(&live.client).or_default() += 1;
        }
        let turn = |client: &str| {
            let last = self.begun.iter().rposition(|c| c == client);
            (running.get(client).copied().unwrap_or(0), last)
        };
        let waiting = self.queue.iter().enumerate();
        // What is queued and not at hand was cancelled meanwhile.
        let known = waiting.filter_map(|(at, number)| Some((turn(&self.live.get(number)?.client), at)));
        let Some((_, at)) = known.min() else {
            self.queue.clear();
            return None;
        };
        let number = self.queue.remove(at)?;
        let client = self.live.get(&number)?.client.clone();
        self.begun.retain(|c| *c != client);
        self.begun.push_back(client);
        // Whose last turn is that long ago is as good as new.
        let many = self.begun.len().saturating_sub(MOST_BEGUN);
        self.begun.drain(..many);
        Some(number)
    }
}

impl Shared {
    /// The jobs, for a moment.
    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Since the runner started.
    pub fn now(&self) -> Duration {
        self.origin.elapsed()
    }

    /// A line of a job's log.
    pub fn line(&self, number: i64, text: &str) {
        self.store.note_line(number, Level::Info, text);
    }

    /// A job's work.
    pub fn make(&self, kind: &str, plan: &Value) -> Result<Work> {
        match self.recipes.get(kind) {
            Some(recipe) if !plan.is_null() => recipe(plan),
            _ => Err(Error::Interrupted {
                reason:
                    "the server stopped while it ran, and this version cannot go on with it; start it again"
                        .into(),
            }),
        }
    }

    /// Goes on with what an earlier server left.
    pub fn take_up(&self, mut row: JobRow) -> Result<()> {
        let mut state = self.state();
        let (number, waiting) = (row.number, row.state == JobState::Waiting);
        let work = if row.starts >= MOST_STARTS {
            let times = row.starts;
            let reason =
                format!("the server ended {times} times while this job ran, which got nowhere in between");
            Err(Error::Failed(format!(
                "{reason}; ask for less, or look at the server's log before you try again"
            )))
        } else {
            self.make(&row.kind, &row.plan)
        };
        if !waiting {
            row.state = JobState::Queued;
        }
        row.events += 1;
        self.store.update_job(&row)?;
        let times = match row.starts {
            0 => String::new(),
            1 => "; it was begun once before without getting anywhere since".into(),
            n => format!("; it was begun {n} times before without getting anywhere since"),
        };
        let goes = if waiting { "it waits for answers again" } else { "it is queued again" };
        self.line(number, &format!("the server was started: {goes}{times}"));
        state.live.insert(number, Live::new(row, "", None));
        match work {
            Err(e) => self.end(&mut state, number, Err(e)),
            Ok(_) if waiting => {}
            Ok(work) => {
                state.queue.push_back(number);
                state.live.entry(number).and_modify(|live| live.work = Some(work));
            }
        }
        Ok(())
    }

    /// A worker's life.
    pub fn work(&self, pool: &rayon::ThreadPool) {
        while let Some((number, work, cancel, owner)) = self.take() {
            let id = id(number);
            let stage = Running { shared: self, number, cancel: &cancel, begun: Instant::now() };
            let context = Context { id: &id, number, owner: owner.as_deref(), stage: &stage };
            let result = catch_unwind(AssertUnwindSafe(|| pool.install(|| work(&context))))
                .unwrap_or_else(|_| Err(Error::Failed("the program has a defect: the work panicked".into())));
            let mut state = self.state();
            match result {
                Ok(Outcome::Waiting) => self.wait(&mut state, number),
                Ok(Outcome::Done(value)) => self.end(&mut state, number, Ok(value)),
                Err(Error::Cancelled)
                    if self.stopping.load(Ordering::SeqCst) && !cancel.load(Ordering::SeqCst) =>
                {
                    // The store has it queued; its watchers learn that it will go on.
                    self.line(number, "the server stops; the next one goes on with it");
                    if let Some(live) = state.live.get_mut(&number) {
                        live.row.state = JobState::Queued;
                        live.emit(None);
                    }
                }
                Err(e) => self.end(&mut state, number, Err(e)),
            }
        }
    }

    /// The next job, made running; `None` when the runner stops.
    fn take(&self) -> Option<(i64, Work, Arc<AtomicBool>, Option<String>)> {
        let mut state = self.state();
        loop {
            if self.stopping.load(Ordering::SeqCst) {
                return None;
            }
            if let Some(number) = state.pop() {
                let taken = state.live.get_mut(&number).and_then(|live| {
                    let work = live.work.take()?;
                    live.row.state = JobState::Running;
                    live.again = false;
                    live.pace = Pace::default();
                    live.figures.clear();
                    live.emit(None);
                    self.line(number, "begun");
                    if let Err(e) = self.store.begin_job(number) {
                        // The job still runs; only a start that ends the server would not be counted.
                        tracing::error!("the start of job {number} could not be stored: {e}");
                    }
                    Some((number, work, live.cancel.clone(), live.row.owner.clone()))
                });
                if taken.is_some() {
                    return taken;
                }
                continue;
            }
            state = self.wake.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Lets a job wait for answers, unless they have come.
    fn wait(&self, state: &mut State, number: i64) {
        let Some(live) = state.live.get_mut(&number) else { return };
        if live.cancel.load(Ordering::SeqCst) {
            return self.end(state, number, Err(Error::Cancelled));
        }
        let go_on = live.again.then(|| self.make(&live.row.kind, &live.row.plan)).transpose();
        live.row.state = if live.again { JobState::Queued } else { JobState::Waiting };
        self.line(
            number,
            if live.again { "all answers are there; queued again" } else { "waits for answers" },
        );
        live.emit(None);
        if let Err(e) = self.store.update_job(&live.row) {
            // At the worst a restart finds it running, and has it wait again.
            tracing::error!("job {number} could not be stored: {e}");
        }
        match go_on {
            Ok(Some(work)) => {
                live.work = Some(work);
                state.queue.push_back(number);
                self.wake.notify_one();
            }
            Ok(None) => {}
            Err(e) => self.end(state, number, Err(e)),
        }
    }

    /// Writes down how a job ended and tells its watchers.
    pub fn end(&self, state: &mut State, number: i64, result: Result<Value>) {
        state.queue.retain(|n| *n != number);
        let Some(live) = state.live.get_mut(&number) else { return };
        live.work = None;
        match result {
            Ok(value) => (live.row.state, live.row.result) = (JobState::Succeeded, Some(value)),
            Err(Error::Cancelled) => live.row.state = JobState::Cancelled,
            Err(e) => (live.row.state, live.row.error) = (JobState::Failed, Some((self.config.explain)(&e))),
        }
        match live.row.error.as_ref().map(|e| e["detail"].as_str().unwrap_or("no reason is known")) {
            Some(why) => self.store.note_line(number, Level::Error, &format!("failed: {why}")),
            None => self.line(number, live.row.state.name()),
        }
        live.row.events += 1;
        let stored = self.store.update_job(&live.row);
        live.row.events -= 1;
        if let Err(e) = stored {
            // Not lasting is better said than hidden; in memory the result stays available.
            tracing::error!("job {number} could not be stored: {e}");
        }
        live.emit(None);
        (self.told)(&live.row);
        live.size = live.row.size();
        state.forget();
    }
}

/// Ended jobs whose events are kept.
const KEPT_JOBS: usize = 64;
/// What they may take with their plans and results, bytes as JSON; the latest is kept whatever it takes.
const KEPT_BYTES: usize = 8 * 1024 * 1024;

/// Figures between two events of a job; work that tells more than an eye can follow is cut short.
const MOST_FIGURES: usize = 256;

/// A job under way.
struct Running<'a> {
    shared: &'a Shared,
    number: i64,
    /// Set by its owner.
    cancel: &'a AtomicBool,
    begun: Instant,
}

impl Stage for Running<'_> {
    fn look(&self) -> Result<()> {
        if self.cancel.load(Ordering::SeqCst) || self.shared.stopping.load(Ordering::SeqCst) {
            return Err(Error::Cancelled);
        }
        if let Some(most) = self.shared.config.most.filter(|most| self.begun.elapsed() > *most) {
            return Err(Error::Deadline { seconds: most.as_secs_f64() });
        }
        Ok(())
    }

    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.look()?;
        let mut state = self.shared.state();
        if let Some(live) = state.live.get_mut(&self.number) {
            // A percent at a time is all an eye can follow; every event is sent to every watcher.
            let percent = |done: u64, total: u64| (done * 100).checked_div(total).unwrap_or(0);
            let (row, now) = (&mut live.row, self.shared.now());
            let news = row.stage != stage || percent(row.done, row.total) != percent(done, total);
            if row.stage != stage || done < row.done {
                live.pace.begin(now, done);
            }
            (row.done, row.total) = (done, total);
            if row.stage != stage {
                row.stage = stage.to_string();
                self.shared.line(self.number, stage);
            }
            if news {
                live.emit(live.pace.left(now, done, total));
            }
        }
        Ok(())
    }

    fn warn(&self, text: &str) {
        self.shared.store.note_line(self.number, Level::Warning, text);
    }

    fn figure(&self, figure: Figure) {
        if let Some(live) = self.shared.state().live.get_mut(&self.number)
            && live.figures.len() < MOST_FIGURES
        {
            live.figures.push(figure);
        }
    }

    fn round(&self, done: u64, total: u64) {
        if let Some(live) = self.shared.state().live.get_mut(&self.number)
            && live.pace.round(self.shared.now(), done, total)
        {
            self.shared.line(self.number, &format!("{done} of {total} rounds are finished"));
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// A queue of jobs by the first letter of whose they are.
    fn queued(clients: &str) -> State {
        let store = Store::in_memory().unwrap();
        let mut state = State::default();
        for client in clients.chars() {
            let row = store.add_job("act", &json!({}), &json!(1), 0, None, &|_| None).unwrap();
            state.queue.push_back(row.number);
            state.live.insert(row.number, Live::new(row, &client.to_string(), None));
        }
        state
    }

    /// Whose jobs are begun, one after the other with so many workers.
    fn begun(mut state: State, workers: usize) -> String {
        let (mut running, mut order) = (VecDeque::new(), String::new());
        while let Some(number) = state.pop() {
            let live = state.live.get_mut(&number).unwrap();
            live.row.state = JobState::Running;
            order += &live.client;
            running.push_back(number);
            if running.len() == workers {
                let ended = running.pop_front().unwrap();
                state.live.get_mut(&ended).unwrap().row.state = JobState::Succeeded;
            }
        }
        order
    }

    #[test]
    fn clients_take_turns_however_many_jobs_one_of_them_queued() {
        assert_eq!(begun(queued("aaaaaa"), 2), "aaaaaa");
        assert_eq!(begun(queued("aaaaaabb"), 1), "ababaaaa");
        assert_eq!(begun(queued("aaaaaabbc"), 2), "abcabaaaa");
        let mut state = queued("aabb");
        assert_eq!(state.pop(), Some(1), "the oldest of its client");
        state.live.get_mut(&1).unwrap().row.state = JobState::Running;
        assert_eq!(state.pop(), Some(3), "who has one running waits for who has none");
        state.live.remove(&2);
        assert_eq!((state.pop(), state.pop()), (Some(4), None), "what is no longer at hand is left out");
    }

    #[test]
    fn of_ended_jobs_only_the_latest_are_at_hand_and_not_the_large_ones() {
        let ended = |count: usize, size: usize| {
            let mut state = queued(&"a".repeat(count));
            for live in state.live.values_mut() {
                (live.row.state, live.size) = (JobState::Succeeded, size);
            }
            state.live.get_mut(&1).unwrap().row.state = JobState::Waiting;
            state.forget();
            (state.live.len(), *state.live.keys().nth(1).unwrap())
        };
        assert_eq!(ended(70, 1000), (65, 7), "64, and the one that has not ended");
        assert_eq!(ended(10, KEPT_BYTES / 4), (5, 7));
        assert_eq!(ended(10, 2 * KEPT_BYTES), (2, 10));
    }

    #[test]
    fn who_fills_the_queue_keeps_nobody_out() {
        let full = queued(&"a".repeat(16));
        assert!(full.is_full("a", 16) && !full.is_full("b", 16) && !full.is_full("a", 17));
        let own = queued(&("a".repeat(14) + "bb"));
        assert!(own.is_full("b", 16), "it has its two");
        assert!(queued(&"a".repeat(32)).is_full("b", 16), "twice is the end of it");
        assert!(queued("a").is_full("b", 1), "a queue of one has nothing to keep");
    }
}
