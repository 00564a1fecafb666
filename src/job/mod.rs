//! Work that takes long: a bounded queue, threads of its own, progress to watch, and a way to stop it.
//!
//! States: queued -> running -> succeeded | failed | cancelled; queued -> cancelled. A job's events are
//! numbered from 1 and kept (the last [`KEPT_EVENTS`]), so that a watcher who lost its connection goes on where
//! it was. Ended jobs live in the store; a job that had not ended when the server stopped has failed.
//!
//! Every worker runs its job in a rayon pool of its own: a job that waits in parallel code can then never be
//! handed another job, and single requests are not queued behind a job's thousands of rollouts.

use std::collections::{BTreeMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde_json::Value;
use tokio::sync::watch;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::store::{JobRow, JobState, Store};

/// What a job does: reports progress, returns its result. Sees its own id.
pub type Work = Box<dyn FnOnce(&str, &dyn Progress) -> Result<Value> + Send>;

/// Limits of a runner, and how it words failures.
#[derive(Clone, Copy)]
pub struct RunnerConfig {
    /// Jobs running at a time.
    pub workers: usize,
    /// Most jobs waiting.
    pub queue: usize,
    /// Threads a running job computes with; 0 for all cores.
    pub threads: usize,
    /// What a job's owner is told about an error.
    pub explain: fn(&Error) -> Value,
}

/// Runs jobs. Dropping it stops them.
pub struct Runner {
    shared: Arc<Shared>,
    workers: Mutex<Vec<JoinHandle<()>>>,
}

/// A job with the id of its last event.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Unique, restarts included.
    pub id: String,
    /// What is known of it.
    pub row: JobRow,
}

/// What deleting a job did.
#[derive(Clone, Debug, PartialEq)]
pub enum Deleted {
    /// It is told to stop (or will not start).
    Cancelled(Box<Job>),
    /// It had ended and is forgotten.
    Forgotten,
}

/// Events of a job from some point on.
pub struct Watcher {
    shared: Arc<Shared>,
    number: i64,
    seen: u64,
    changed: watch::Receiver<u64>,
    /// An ended job of which nothing but the end is known.
    ended: Option<Job>,
}

/// Events kept of a running job; a watcher further behind misses the oldest.
pub const KEPT_EVENTS: usize = 1024;

struct Shared {
    store: Arc<Store>,
    config: RunnerConfig,
    state: Mutex<State>,
    /// Told when there is work or the runner stops.
    wake: Condvar,
    stopping: AtomicBool,
}

#[derive(Default)]
struct State {
    queue: VecDeque<i64>,
    /// Jobs that have not ended, and recently ended ones that may be watched.
    live: BTreeMap<i64, Live>,
}

struct Live {
    row: JobRow,
    work: Option<Work>,
    cancel: Arc<AtomicBool>,
    events: VecDeque<Event>,
    changed: watch::Sender<u64>,
}

struct Event {
    id: u64,
    state: JobState,
    stage: String,
    done: u64,
    total: u64,
}

impl Runner {
    /// Starts the workers; jobs left unfinished by an earlier server fail with the reason.
    pub fn start(store: Arc<Store>, config: RunnerConfig) -> Result<Runner> {
        store.fail_unfinished(&(config.explain)(&stopped()))?;
        let shared = Arc::new(Shared {
            store,
            config,
            state: Mutex::default(),
            wake: Condvar::new(),
            stopping: AtomicBool::new(false),
        });
        let workers = (0..config.workers)
            .map(|i| {
                let shared = shared.clone();
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(config.threads)
                    .thread_name(move |t| format!("job-{i}-{t}"))
                    .build()
                    .map_err(|e| Error::Failed(format!("no threads for jobs: {e}")))?;
                std::thread::Builder::new()
                    .name(format!("job-{i}"))
                    .spawn(move || shared.work(&pool))
                    .map_err(|e| Error::Failed(format!("no thread for jobs: {e}")))
            })
            .collect::<Result<_>>()?;
        Ok(Runner { shared, workers: Mutex::new(workers) })
    }

    /// Queues a job. `config` is kept with it and shown.
    pub fn submit(&self, kind: &str, config: &Value, seed: u64, work: Work) -> Result<Job> {
        let mut state = self.shared.state();
        if self.shared.stopping.load(Ordering::SeqCst) {
            return Err(Error::Interrupted {
                reason: "the server is stopping; send it to the next one".into(),
            });
        }
        if state.queue.len() >= self.shared.config.queue {
            let advice = "wait for one to end, or cancel one you no longer need";
            return Err(Error::Capacity { what: "waiting jobs", limit: self.shared.config.queue, advice });
        }
        let mut row = self.shared.store.add_job(kind, config, seed)?;
        row.events = 1;
        let live = Live {
            events: VecDeque::from([Event::of(&row)]),
            changed: watch::Sender::new(row.events),
            cancel: Arc::new(AtomicBool::new(false)),
            work: Some(work),
            row: row.clone(),
        };
        state.queue.push_back(row.number);
        state.live.insert(row.number, live);
        drop(state);
        self.shared.wake.notify_one();
        Ok(Job::of(row))
    }

    /// The job called `id`.
    pub fn get(&self, id: &str) -> Result<Job> {
        let number = number(id)?;
        if let Some(live) = self.shared.state().live.get(&number) {
            return Ok(Job::of(live.row.clone()));
        }
        self.shared.store.job(number)?.map(Job::of).ok_or_else(|| unknown(id))
    }

    /// All jobs, oldest first.
    pub fn list(&self) -> Result<Vec<Job>> {
        let mut rows = self.shared.store.jobs()?;
        let state = self.shared.state();
        for row in &mut rows {
            if let Some(live) = state.live.get(&row.number) {
                *row = live.row.clone();
            }
        }
        Ok(rows.into_iter().map(Job::of).collect())
    }

    /// Stops a job that has not ended; forgets one that has.
    pub fn delete(&self, id: &str) -> Result<Deleted> {
        let number = number(id)?;
        let mut state = self.shared.state();
        if let Some(live) = state.live.get_mut(&number)
            && !live.row.state.ended()
        {
            live.cancel.store(true, Ordering::SeqCst);
            if live.row.state == JobState::Queued {
                self.shared.end(&mut state, number, Err(Error::Cancelled));
            }
            let row = state.live.get(&number).map(|l| l.row.clone());
            return row.map(|r| Deleted::Cancelled(Box::new(Job::of(r)))).ok_or_else(|| unknown(id));
        }
        state.live.remove(&number);
        if self.shared.store.remove_job(number)? { Ok(Deleted::Forgotten) } else { Err(unknown(id)) }
    }

    /// Events of a job after event number `after` (0 for all there are).
    pub fn watch(&self, id: &str, after: u64) -> Result<Watcher> {
        let number = number(id)?;
        let shared = self.shared.clone();
        if let Some(live) = self.shared.state().live.get(&number) {
            let changed = live.changed.subscribe();
            return Ok(Watcher { shared, number, seen: after, changed, ended: None });
        }
        let row = self.shared.store.job(number)?.ok_or_else(|| unknown(id))?;
        let changed = watch::Sender::new(row.events).subscribe();
        let ended = Some(Job::of(row));
        Ok(Watcher { shared, number, seen: after, changed, ended })
    }

    /// Stops all jobs; what has not ended has failed with the reason. Waits for the workers, but no longer than
    /// `patience`: a job that has not noticed by then goes with the process, and fails at the next start.
    pub fn stop(&self, patience: Duration) {
        self.shared.stopping.store(true, Ordering::SeqCst);
        {
            let mut state = self.shared.state();
            let waiting: Vec<i64> = state.queue.drain(..).collect();
            for number in waiting {
                self.shared.end(&mut state, number, Err(stopped()));
            }
            for live in state.live.values() {
                live.cancel.store(true, Ordering::SeqCst);
            }
        }
        self.shared.wake.notify_all();
        let workers = self.workers.lock().unwrap_or_else(PoisonError::into_inner);
        let deadline = Instant::now() + patience;
        while workers.iter().any(|w| !w.is_finished()) && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Runner {
    fn drop(&mut self) {
        self.stop(Duration::from_secs(10));
    }
}

impl Watcher {
    /// Waits for the next event: its id and the job as it was then. `None` after the last.
    pub async fn next(&mut self) -> Option<(u64, Job)> {
        loop {
            if let Some(job) = self.ended.take() {
                return (job.row.events > self.seen).then_some((job.row.events, job));
            }
            self.changed.borrow_and_update();
            {
                let state = self.shared.state();
                let live = state.live.get(&self.number)?;
                if let Some(event) = live.events.iter().find(|e| e.id > self.seen) {
                    self.seen = event.id;
                    return Some((event.id, Job::of(event.job(&live.row))));
                }
                if live.row.state.ended() {
                    return None;
                }
            }
            self.changed.changed().await.ok()?;
        }
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

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A worker's life.
    fn work(&self, pool: &rayon::ThreadPool) {
        while let Some((number, work, cancel)) = self.take() {
            let id = id(number);
            let reporter = Reporter { shared: self, number, cancel };
            let result = catch_unwind(AssertUnwindSafe(|| pool.install(|| work(&id, &reporter))))
                .unwrap_or_else(|_| Err(Error::Failed("the program has a defect: the work panicked".into())));
            let result = match result {
                Err(Error::Cancelled) if self.stopping.load(Ordering::SeqCst) => Err(stopped()),
                other => other,
            };
            self.end(&mut self.state(), number, result);
        }
    }

    /// The next job, made running; `None` when the runner stops.
    fn take(&self) -> Option<(i64, Work, Arc<AtomicBool>)> {
        let mut state = self.state();
        loop {
            if self.stopping.load(Ordering::SeqCst) {
                return None;
            }
            if let Some(number) = state.queue.pop_front() {
                let taken = state.live.get_mut(&number).and_then(|live| {
                    live.row.state = JobState::Running;
                    live.emit();
                    // If this fails the job still runs; only a restart would take it for queued, which it fails too.
                    let _ = self.store.update_job(&live.row);
                    Some((number, live.work.take()?, live.cancel.clone()))
                });
                if taken.is_some() {
                    return taken;
                }
                continue;
            }
            state = self.wake.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Writes down how a job ended and tells its watchers.
    fn end(&self, state: &mut State, number: i64, result: Result<Value>) {
        state.queue.retain(|n| *n != number);
        let Some(live) = state.live.get_mut(&number) else { return };
        live.work = None;
        match result {
            Ok(value) => (live.row.state, live.row.result) = (JobState::Succeeded, Some(value)),
            Err(Error::Cancelled) => live.row.state = JobState::Cancelled,
            Err(e) => (live.row.state, live.row.error) = (JobState::Failed, Some((self.config.explain)(&e))),
        }
        live.row.events += 1;
        let stored = self.store.update_job(&live.row);
        live.row.events -= 1;
        if let Err(e) = stored {
            // Not lasting is better said than hidden; in memory the result stays available.
            tracing::error!("job {number} could not be stored: {e}");
        }
        live.emit();
        // Once stored, an ended job is kept here only for its events; forget the oldest.
        let ended: Vec<i64> =
            state.live.iter().filter(|(_, l)| l.row.state.ended()).map(|(n, _)| *n).collect();
        for old in ended.iter().take(ended.len().saturating_sub(KEPT_JOBS)) {
            state.live.remove(old);
        }
    }
}

/// Ended jobs whose events are kept.
const KEPT_JOBS: usize = 64;

impl Live {
    fn emit(&mut self) {
        self.row.events += 1;
        if self.events.len() == KEPT_EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(Event::of(&self.row));
        self.changed.send_replace(self.row.events);
    }
}

impl Event {
    fn of(row: &JobRow) -> Event {
        let (stage, done, total) = (row.stage.clone(), row.done, row.total);
        Event { id: row.events, state: row.state, stage, done, total }
    }

    /// The job as it was at this event.
    fn job(&self, now: &JobRow) -> JobRow {
        let ended = self.state.ended();
        JobRow {
            state: self.state,
            stage: self.stage.clone(),
            done: self.done,
            total: self.total,
            events: self.id,
            result: now.result.clone().filter(|_| ended),
            error: now.error.clone().filter(|_| ended),
            ..now.clone()
        }
    }
}

/// What a job reports to.
struct Reporter<'a> {
    shared: &'a Shared,
    number: i64,
    cancel: Arc<AtomicBool>,
}

impl Progress for Reporter<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        if self.cancel.load(Ordering::SeqCst) {
            return Err(Error::Cancelled);
        }
        let mut state = self.shared.state();
        if let Some(live) = state.live.get_mut(&self.number) {
            // A percent at a time is all an eye can follow; every event is sent to every watcher.
            let percent = |done: u64, total: u64| (done * 100).checked_div(total).unwrap_or(0);
            let row = &mut live.row;
            let news = row.stage != stage || percent(row.done, row.total) != percent(done, total);
            (row.done, row.total) = (done, total);
            if row.stage != stage {
                row.stage = stage.to_string();
            }
            if news {
                live.emit();
            }
        }
        Ok(())
    }
}

impl Job {
    fn of(row: JobRow) -> Job {
        Job { id: id(row.number), row }
    }
}

fn id(number: i64) -> String {
    format!("job-{number}")
}

fn number(id: &str) -> Result<i64> {
    let number = id.strip_prefix("job-").and_then(|n| n.parse().ok());
    number.filter(|n| self::id(*n) == id).ok_or_else(|| unknown(id))
}

fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "job", id: id.to_string(), known: Vec::new() }
}

fn stopped() -> Error {
    Error::Interrupted { reason: "server stopped while it ran; start it again".into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::sync::mpsc;

    fn runner(queue: usize) -> Runner {
        let explain = |e: &Error| json!({"detail": e.to_string()});
        let config = RunnerConfig { workers: 1, queue, threads: 1, explain };
        Runner::start(Arc::new(Store::in_memory().unwrap()), config).unwrap()
    }

    /// All events from `after` on, to the end.
    fn events(runner: &Runner, id: &str, after: u64) -> Vec<(u64, Job)> {
        let mut watcher = runner.watch(id, after).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        runtime.block_on(async {
            let mut all = Vec::new();
            while let Some(event) = watcher.next().await {
                all.push(event);
            }
            all
        })
    }

    #[test]
    fn progress_is_replayed_from_where_a_watcher_was() {
        let runner = runner(4);
        let work: Work = Box::new(|id, progress| {
            for i in 0..=4 {
                progress.report("counting", i, 4)?;
            }
            Ok(json!({ "id": id }))
        });
        let job = runner.submit("count", &json!({}), 0, work).unwrap();
        let all = events(&runner, &job.id, 0);
        let states: Vec<&str> = all.iter().map(|(_, j)| j.row.state.name()).collect();
        assert_eq!(states[..2], ["queued", "running"]);
        assert_eq!(all.last().unwrap().1.row.result, Some(json!({ "id": job.id })));
        assert_eq!(
            all.iter().map(|(n, _)| *n).collect::<Vec<_>>(),
            (1..=all.len() as u64).collect::<Vec<_>>()
        );
        assert_eq!(events(&runner, &job.id, 3), all[3..]);
        assert_eq!(events(&runner, &job.id, all.len() as u64), []);
        assert!(runner.watch(&job.id, all.len() as u64).unwrap().exhausted());
        assert_eq!(runner.get(&job.id).unwrap(), all.last().unwrap().1);
    }

    /// Work that goes on until it is stopped, and what tells that it has begun.
    fn endless() -> (Work, mpsc::Receiver<()>) {
        let (started, wait) = mpsc::channel();
        let work: Work = Box::new(move |_, progress| {
            started.send(()).unwrap();
            loop {
                progress.report("waiting", 0, 1)?;
                std::thread::yield_now();
            }
        });
        (work, wait)
    }

    #[test]
    fn running_and_waiting_jobs_are_cancelled_and_the_queue_is_bounded() {
        let runner = runner(1);
        let (endless, wait) = endless();
        let running = runner.submit("endless", &json!({}), 0, endless).unwrap();
        wait.recv().unwrap();
        let waiting = runner.submit("x", &json!({}), 0, Box::new(|_, _| Ok(json!(1)))).unwrap();
        let full = runner.submit("x", &json!({}), 0, Box::new(|_, _| Ok(json!(1))));
        assert!(matches!(full, Err(Error::Capacity { limit: 1, .. })));
        assert!(
            matches!(runner.delete(&waiting.id).unwrap(), Deleted::Cancelled(j) if j.row.state == JobState::Cancelled)
        );
        assert!(matches!(runner.delete(&running.id).unwrap(), Deleted::Cancelled(_)));
        assert_eq!(events(&runner, &running.id, 0).last().unwrap().1.row.state, JobState::Cancelled);
        assert_eq!(runner.delete(&running.id).unwrap(), Deleted::Forgotten);
        assert!(
            runner.get(&running.id).is_err()
                && runner.delete("job-7").is_err()
                && runner.get("job-+1").is_err()
        );
    }

    #[test]
    fn a_panic_or_an_error_fails_the_job_and_not_the_runner() {
        let runner = runner(4);
        let panics = runner.submit("p", &json!({}), 0, Box::new(|_, _| panic!("defect"))).unwrap();
        let fails =
            runner.submit("f", &json!({}), 0, Box::new(|_, _| Err(Error::Failed("no".into())))).unwrap();
        for (job, word) in [(panics, "panicked"), (fails, "no")] {
            let end = events(&runner, &job.id, 0).pop().unwrap().1.row;
            assert_eq!(end.state, JobState::Failed);
            assert!(end.error.unwrap()["detail"].as_str().unwrap().contains(word));
        }
    }

    #[test]
    fn stopping_fails_what_ran_with_the_reason() {
        let runner = runner(4);
        let (endless, wait) = endless();
        let job = runner.submit("endless", &json!({}), 0, endless).unwrap();
        wait.recv().unwrap();
        runner.stop(Duration::from_secs(60));
        let row = runner.get(&job.id).unwrap().row;
        assert_eq!(row.state, JobState::Failed);
        assert!(row.error.unwrap()["detail"].as_str().unwrap().contains("start it again"));
        assert!(runner.submit("x", &json!({}), 0, Box::new(|_, _| Ok(json!(1)))).is_err());
    }
}
