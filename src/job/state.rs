//! State shared by a runner and the threads of its jobs: starts, runs and ends them.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::active::ActiveJob;
use super::eta::EtaEstimator;
use super::queue::JobQueue;
use super::record::{Figure, id};
use super::summary::summarize;
use super::work::{JobContext, JobReporter, Work, WorkFactories, WorkOutcome};
use crate::error::{Error, Result};
use crate::store::{JobRow, JobState, LogLevel, Store, unix_ms};
use crate::sync::lock;
use crate::thread_priority::lower;

/// Limits of a runner, and its error format.
#[derive(Clone, Copy)]
pub struct RunnerConfig {
    /// Jobs running at a time; a client's first job runs beside those of other clients.
    pub running: usize,
    /// Maximum queued jobs.
    pub queue: usize,
    /// Maximum queued jobs of one client.
    pub owner_queue: usize,
    /// Threads of a running job; 0 for the size of rayon's global pool.
    pub threads: usize,
    /// Maximum computing time of a job between its start and its end or wait.
    pub max_run_time: Option<Duration>,
    /// Formats an error for the job's owner.
    pub explain: fn(&Error) -> Value,
}

/// Callback for jobs that have ended.
pub type OnJobEnd = Box<dyn Fn(&JobRow) + Send + Sync>;

/// Starts without progress after which a job fails. A start during which memory was scarce counts as [`SCARCE_START_WEIGHT`], so
/// that a job that ended the server twice by taking all memory is not tried again.
pub const MAX_STARTS_WITHOUT_PROGRESS: u32 = 5;
/// Weight of a start during which memory was scarce.
pub const SCARCE_START_WEIGHT: u32 = 3;
/// State shared by a runner and the threads of its jobs.
pub struct RunnerState {
    pub store: Arc<Store>,
    pub work_factories: WorkFactories,
    pub config: Mutex<RunnerConfig>,
    pub on_job_end: OnJobEnd,
    pub state: Mutex<JobQueue>,
    /// Threads that run a job.
    pub threads: AtomicUsize,
    pub stopping: AtomicBool,
    /// Origin of the runner's clock.
    pub origin: Instant,
}

/// A job that is marked as running, with its work.
struct StartedJob {
    number: i64,
    work: Work,
    cancel: Arc<AtomicBool>,
    owner: Option<String>,
}

impl RunnerState {
    /// Locks the jobs.
    pub fn state(&self) -> MutexGuard<'_, JobQueue> {
        lock(&self.state)
    }

    /// Time since the runner started.
    pub fn now(&self) -> Duration {
        self.origin.elapsed()
    }

    /// Writes a line to a job's log.
    pub fn log_line(&self, number: i64, text: &str) {
        self.store.note_line(number, LogLevel::Info, text);
    }

    /// Builds a job's work from its plan.
    pub fn build_work(&self, kind: &str, plan: &Value) -> Result<Work> {
        match self.work_factories.get(kind) {
            Some(work_factory) if !plan.is_null() => work_factory(plan),
            _ => Err(Error::Interrupted {
                reason:
                    "the server stopped while the job ran, and this version cannot resume it; start it again"
                        .into(),
            }),
        }
    }

    /// Resumes a job of an earlier server.
    pub fn resume(&self, mut row: JobRow) -> Result<()> {
        let mut state = self.state();
        let (number, waiting) = (row.number, row.state == JobState::Waiting);
        let work = if row.starts >= MAX_STARTS_WITHOUT_PROGRESS {
            let times = row.starts;
            let reason = format!("the server ended {times} times while this job ran without progress");
            Err(Error::Failed(format!(
                "{reason}; reduce the job, or check the server's log before you try again"
            )))
        } else {
            self.build_work(&row.kind, &row.plan)
        };
        if !waiting {
            row.state = JobState::Queued;
        }
        row.events += 1;
        self.store.update_job(&row)?;
        let times = match row.starts {
            0 => String::new(),
            1 => "; it was started once before without progress".into(),
            n => format!("; it was started {n} times before without progress"),
        };
        let goes = if waiting { "the job waits for results again" } else { "the job is queued again" };
        self.log_line(number, &format!("the server was started: {goes}{times}"));
        state.jobs.insert(number, ActiveJob::new(row, "", None));
        match work {
            Err(e) => self.end(&mut state, number, Err(e)),
            Ok(_) if waiting => {}
            Ok(work) => {
                state.queue.push_back(number);
                state.jobs.entry(number).and_modify(|live| live.work = Some(work));
            }
        }
        Ok(())
    }

    /// The configuration in force.
    pub fn config(&self) -> RunnerConfig {
        *lock(&self.config)
    }

    /// Starts the queued jobs that may run, each on its own thread.
    pub fn start_jobs(self: &Arc<RunnerState>) {
        while let Some(job) = self.take() {
            let (shared, number) = (self.clone(), job.number);
            self.threads.fetch_add(1, Ordering::SeqCst);
            let run = move || {
                shared.run(job);
                shared.start_jobs();
                shared.threads.fetch_sub(1, Ordering::SeqCst);
            };
            if let Err(e) = std::thread::Builder::new().name(id(number)).spawn(run) {
                self.threads.fetch_sub(1, Ordering::SeqCst);
                let error = Error::Failed(format!("the job's thread cannot be started: {e}"));
                self.end(&mut self.state(), number, Err(error));
            }
        }
    }

    /// Runs a job to its end, or until it waits for results or the runner stops.
    fn run(&self, StartedJob { number, work, cancel, owner }: StartedJob) {
        let id = id(number);
        let stage = Running { shared: self, number, cancel: &cancel, started: Instant::now() };
        let context = JobContext { id: &id, number, owner: owner.as_deref(), stage: &stage };
        let threads = match self.config().threads {
            0 => rayon::current_num_threads(),
            some => some,
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let result =
            match pool.thread_name(move |t| format!("job-{number}-{t}")).start_handler(|_| lower()).build() {
                Ok(pool) => catch_unwind(AssertUnwindSafe(|| pool.install(|| work(&context))))
                    .unwrap_or_else(|_| Err(Error::Failed("a bug in the program: the work panicked".into()))),
                Err(e) => Err(Error::Failed(format!("the job's threads cannot be started: {e}"))),
            };
        let mut state = self.state();
        match result {
            Ok(WorkOutcome::Waiting) => self.wait_for_results(&mut state, number),
            Ok(WorkOutcome::Done(value)) => self.end(&mut state, number, Ok(value)),
            Err(Error::Cancelled)
                if self.stopping.load(Ordering::SeqCst) && !cancel.load(Ordering::SeqCst) =>
            {
                // The store has it queued; its watchers learn that it will continue.
                self.log_line(number, "the server stops; the next one resumes the job");
                if let Some(live) = state.jobs.get_mut(&number) {
                    live.row.state = JobState::Queued;
                    live.emit(None);
                }
            }
            Err(e) => self.end(&mut state, number, Err(e)),
        }
    }

    /// Takes the next job that may run and marks it as running.
    fn take(&self) -> Option<StartedJob> {
        let mut state = self.state();
        while !self.stopping.load(Ordering::SeqCst) {
            let number = state.pop_next(self.config().running)?;
            let Some(live) = state.jobs.get_mut(&number) else { continue };
            let Some(work) = live.work.take() else { continue };
            live.row.state = JobState::Running;
            live.results_complete = false;
            live.scarce_memory = false;
            live.eta = EtaEstimator::default();
            live.figures.clear();
            let now = unix_ms();
            live.row.metadata.started.get_or_insert(now);
            live.emit(None);
            self.log_line(number, "started");
            if let Err(e) = self.store.begin_job(number, now) {
                // The job runs all the same; only this start is not counted if it ends the server.
                tracing::error!("the start of job {number} could not be stored: {e}");
            }
            return Some(StartedJob {
                number,
                work,
                cancel: live.cancel.clone(),
                owner: live.row.owner.clone(),
            });
        }
        None
    }

    /// Lets a job wait for results, unless they have arrived.
    fn wait_for_results(&self, state: &mut JobQueue, number: i64) {
        let Some(live) = state.jobs.get_mut(&number) else { return };
        if live.cancel.load(Ordering::SeqCst) {
            return self.end(state, number, Err(Error::Cancelled));
        }
        let go_on =
            live.results_complete.then(|| self.build_work(&live.row.kind, &live.row.plan)).transpose();
        live.row.state = if live.results_complete { JobState::Queued } else { JobState::Waiting };
        self.log_line(
            number,
            if live.results_complete {
                "all results have arrived; queued again"
            } else {
                "waits for results"
            },
        );
        live.emit(None);
        if let Err(e) = self.store.update_job(&live.row) {
            // At worst a restart finds it running and lets it wait again.
            tracing::error!("job {number} could not be stored: {e}");
        }
        match go_on {
            Ok(Some(work)) => {
                live.work = Some(work);
                state.queue.push_back(number);
            }
            Ok(None) => {}
            Err(e) => self.end(state, number, Err(e)),
        }
    }

    /// Stores the end of a job and notifies its watchers.
    pub fn end(&self, state: &mut JobQueue, number: i64, result: Result<Value>) {
        state.queue.retain(|n| *n != number);
        let Some(live) = state.jobs.get_mut(&number) else { return };
        live.work = None;
        match result {
            Ok(value) => {
                live.row.metadata.summary = summarize(&live.row.kind, &value);
                (live.row.state, live.row.result) = (JobState::Succeeded, Some(value));
            }
            Err(Error::Cancelled) => live.row.state = JobState::Cancelled,
            Err(e) => {
                (live.row.state, live.row.error) = (JobState::Failed, Some((self.config().explain)(&e)))
            }
        }
        live.row.metadata.ended = Some(unix_ms());
        match live.row.error.as_ref().map(|e| e["detail"].as_str().unwrap_or("unknown reason")) {
            Some(why) => self.store.note_line(number, LogLevel::Error, &format!("failed: {why}")),
            None => self.log_line(number, live.row.state.name()),
        }
        live.row.events += 1;
        let stored = self.store.update_job(&live.row);
        live.row.events -= 1;
        if let Err(e) = stored {
            // The result stays available in memory; the log reports that it is not stored.
            tracing::error!("job {number} could not be stored: {e}");
        }
        live.emit(None);
        (self.on_job_end)(&live.row);
        live.size = live.row.size();
        state.evict_ended();
    }
}

/// Maximum figures of an event; further ones are dropped.
const MAX_FIGURES_PER_EVENT: usize = 256;

/// A running job.
struct Running<'a> {
    shared: &'a RunnerState,
    number: i64,
    /// Set to cancel the job.
    cancel: &'a AtomicBool,
    started: Instant,
}

impl JobReporter for Running<'_> {
    fn check_stop(&self) -> Result<()> {
        if self.cancel.load(Ordering::SeqCst) || self.shared.stopping.load(Ordering::SeqCst) {
            return Err(Error::Cancelled);
        }
        if let Some(most) = self.shared.config().max_run_time.filter(|most| self.started.elapsed() > *most) {
            return Err(Error::Deadline { seconds: most.as_secs_f64() });
        }
        Ok(())
    }

    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.check_stop()?;
        let mut state = self.shared.state();
        if let Some(live) = state.jobs.get_mut(&self.number) {
            // One event a percent: every event is sent to every watcher.
            let percent = |done: u64, total: u64| (done * 100).checked_div(total).unwrap_or(0);
            let (row, now) = (&mut live.row, self.shared.now());
            let news = row.stage != stage || percent(row.done, row.total) != percent(done, total);
            if row.stage != stage || done < row.done {
                live.eta.start_stage(now, done);
            }
            (row.done, row.total) = (done, total);
            if row.stage != stage {
                row.stage = stage.to_string();
                self.shared.log_line(self.number, stage);
            }
            if news {
                live.emit(live.eta.seconds_left(now, done, total));
            }
        }
        Ok(())
    }

    fn note(&self, text: &str) {
        self.shared.log_line(self.number, text);
    }

    fn warn(&self, text: &str) {
        self.shared.store.note_line(self.number, LogLevel::Warning, text);
    }

    fn figure(&self, figure: Figure) {
        if let Some(live) = self.shared.state().jobs.get_mut(&self.number)
            && live.figures.len() < MAX_FIGURES_PER_EVENT
        {
            live.figures.push(figure);
        }
    }

    fn round(&self, done: u64, total: u64) {
        if let Some(live) = self.shared.state().jobs.get_mut(&self.number)
            && live.eta.finish_round(self.shared.now(), done, total)
        {
            self.shared.log_line(self.number, &format!("{done} of {total} rounds are finished"));
        }
    }
}
