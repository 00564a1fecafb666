//! Queues, watches and stops jobs: the interface of the job module.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::active::ActiveJob;
use super::record::{DeleteOutcome, Job, number, unknown};
use super::state::{OnJobEnd, RunnerConfig, RunnerState, SCARCE_START_WEIGHT};
use super::watch::Watcher;
use super::work::WorkFactories;
use crate::error::{Error, Result};
use crate::store::{JobList, JobRow, JobState, LogRow, Store, StoredResponse, unix_ms};
use crate::sync::lock;

/// A job to be queued.
pub struct JobSpec<'a> {
    /// Kind of job, one of the factories'.
    pub kind: &'a str,
    /// The request as its owner wrote it; stored and shown.
    pub config: &'a Value,
    /// The plan that the factory gets; stored.
    pub plan: &'a Value,
    pub seed: u64,
}

/// Runs jobs. Dropping it stops them.
pub struct Runner {
    shared: Arc<RunnerState>,
}

impl Runner {
    /// Resumes the unfinished jobs of an earlier server. `on_job_end` is called for every job that ends.
    pub fn start(
        store: Arc<Store>,
        work_factories: WorkFactories,
        config: RunnerConfig,
        on_job_end: OnJobEnd,
    ) -> Result<Runner> {
        let shared = Arc::new(RunnerState {
            store,
            work_factories,
            config: Mutex::new(config),
            on_job_end,
            state: Mutex::default(),
            threads: AtomicUsize::new(0),
            stopping: AtomicBool::new(false),
            origin: Instant::now(),
        });
        for row in shared.store.unfinished()? {
            shared.resume(row)?;
        }
        shared.start_jobs();
        Ok(Runner { shared })
    }

    /// Whether a job runs.
    pub fn is_running(&self) -> bool {
        self.shared.threads.load(Ordering::SeqCst) > 0
    }

    /// Memory is scarce: the present start of every running job weighs more if it is the last thing that happens.
    pub fn note_scarce_memory(&self) -> Result<()> {
        let running: Vec<i64> = {
            let mut state = self.shared.state();
            let new = state
                .jobs
                .values_mut()
                .filter(|live| live.row.state == JobState::Running && !live.scarce_memory);
            new.map(|live| {
                live.scarce_memory = true;
                live.row.number
            })
            .collect()
        };
        running.iter().try_for_each(|number| self.shared.store.weigh_start(*number, SCARCE_START_WEIGHT))
    }

    /// Replaces the configuration; running jobs go on.
    pub fn set_config(&self, config: RunnerConfig) {
        *lock(&self.shared.config) = config;
        self.shared.start_jobs();
    }

    /// Names of the job kinds, sorted.
    pub fn kinds(&self) -> Vec<&'static str> {
        self.shared.work_factories.keys().copied().collect()
    }

    /// Queues a job of `owner`, or of an anonymous client at `place`. The response built by `answered` is stored in the same transaction.
    pub fn submit(
        &self,
        new: JobSpec,
        owner: Option<&str>,
        place: &str,
        answered: &dyn Fn(Job) -> Option<StoredResponse>,
    ) -> Result<Job> {
        let work = self.shared.build_work(new.kind, new.plan)?;
        let mut state = self.shared.state();
        if self.shared.stopping.load(Ordering::SeqCst) {
            return Err(Error::Interrupted {
                reason: "the server is stopping; retry after the restart".into(),
            });
        }
        let (client, config) = (owner.unwrap_or(place), self.shared.config());
        let advice = "wait for one to end, or cancel one you no longer need";
        if state.is_full(client, config.queue) {
            return Err(Error::Capacity { what: "waiting jobs", limit: config.queue, advice });
        }
        if state.queued(client) >= config.owner_queue {
            return Err(Error::Capacity {
                what: "waiting jobs of one client",
                limit: config.owner_queue,
                advice,
            });
        }
        let of = |row: &JobRow| answered(Job::of(row.clone()));
        let row = self.shared.store.add_job(new.kind, new.config, new.plan, new.seed, owner, &of)?;
        self.shared.log_line(row.number, "queued");
        state.queue.push_back(row.number);
        state.jobs.insert(row.number, ActiveJob::new(row.clone(), place, Some(work)));
        drop(state);
        self.shared.start_jobs();
        Ok(Job::of(row))
    }

    /// The job called `id`, of any owner.
    pub fn get(&self, id: &str) -> Result<Job> {
        let number = number(id)?;
        if let Some(live) = self.shared.state().jobs.get(&number) {
            return Ok(live.job(self.shared.now()));
        }
        self.shared.store.job(number)?.map(Job::of).ok_or_else(|| unknown(id))
    }

    /// The job called `id`; unknown if it belongs to an owner other than `owner`, if given.
    pub fn of(&self, id: &str, owner: Option<&str>) -> Result<Job> {
        let job = self.get(id)?;
        if owner.is_none_or(|owner| job.row.owner.as_deref() == Some(owner)) {
            Ok(job)
        } else {
            Err(unknown(id))
        }
    }

    /// At most `limit` jobs in the requested order, after number `after`; of one owner, or of all.
    pub fn list(
        &self,
        list: &JobList,
        after: Option<i64>,
        limit: usize,
        owner: Option<&str>,
    ) -> Result<Vec<Job>> {
        let rows = self.shared.store.jobs(list, after, limit, owner)?;
        let (state, now) = (self.shared.state(), self.shared.now());
        let live = |row: JobRow| {
            let mut job = state.jobs.get(&row.number).map_or_else(|| Job::of(row), |l| l.job(now));
            job.row.result.take_if(|_| list.bare);
            job
        };
        Ok(rows.into_iter().map(live).collect())
    }

    /// At most `limit` lines of the log of the job called `id`, after number `after`.
    pub fn log(&self, id: &str, after: u64, limit: usize) -> Result<Vec<LogRow>> {
        self.shared.store.log(number(id)?, after, limit)
    }

    /// Reports to a waiting job that `answered` of `asked` results have arrived; it resumes when all have.
    pub fn report_results(&self, id: &str, answered: u64, requested: u64) -> Result<Job> {
        let number = number(id)?;
        let mut state = self.shared.state();
        let now = self.shared.now();
        let live = state.jobs.get_mut(&number).ok_or_else(|| unknown(id))?;
        match live.row.state {
            JobState::Waiting if answered >= requested => {
                live.work = Some(self.shared.build_work(&live.row.kind, &live.row.plan)?);
                (live.row.state, live.row.done) = (JobState::Queued, answered);
                live.emit(None);
                self.shared.log_line(number, "all results have arrived; queued again");
                self.shared.store.update_job(&live.row)?;
                let job = live.job(now);
                state.queue.push_back(number);
                drop(state);
                self.shared.start_jobs();
                Ok(job)
            }
            JobState::Waiting => {
                (live.row.done, live.row.total) = (answered, requested);
                self.shared.log_line(number, &format!("{answered} of {requested} results have arrived"));
                live.emit(None);
                Ok(live.job(now))
            }
            JobState::Running => {
                live.results_complete |= answered >= requested;
                Ok(live.job(now))
            }
            _ => Ok(live.job(now)),
        }
    }

    /// Sets the name and the note of a job, each if there is a value. Watchers see them in the next event.
    pub fn annotate(&self, id: &str, name: Option<&str>, note: Option<&str>) -> Result<Job> {
        let number = number(id)?;
        {
            // Locked until both are changed, so that memory and store agree.
            let mut state = self.shared.state();
            if !self.shared.store.annotate_job(number, name, note)? {
                return Err(unknown(id));
            }
            if let Some(live) = state.jobs.get_mut(&number) {
                let metadata = &mut live.row.metadata;
                name.into_iter().for_each(|name| metadata.name = name.into());
                note.into_iter().for_each(|note| metadata.note = note.into());
            }
        }
        self.get(id)
    }

    /// Cancels a job that has not ended; removes one that has.
    pub fn delete(&self, id: &str) -> Result<DeleteOutcome> {
        let number = number(id)?;
        let mut state = self.shared.state();
        if let Some(live) = state.jobs.get_mut(&number)
            && !live.row.state.ended()
        {
            // At once: a large plan takes a while to store.
            live.cancel.store(true, Ordering::SeqCst);
            self.shared.store.cancel_job(number, unix_ms())?;
            if live.row.state == JobState::Running {
                self.shared.log_line(number, "cancellation requested");
            } else {
                self.shared.end(&mut state, number, Err(Error::Cancelled));
            }
            let row = state.jobs.get(&number).map(|l| l.row.clone());
            return row.map(|r| DeleteOutcome::Cancelled(Box::new(Job::of(r)))).ok_or_else(|| unknown(id));
        }
        state.jobs.remove(&number);
        if self.shared.store.remove_job(number)? { Ok(DeleteOutcome::Removed) } else { Err(unknown(id)) }
    }

    /// Removes the jobs that ended before a moment, s since 1970, and their data; returns how many. A cancelled job that is still
    /// running stays.
    pub fn remove_ended(&self, before: u64) -> Result<usize> {
        let mut forgotten = 0;
        for number in self.shared.store.ended_before(before)? {
            let mut state = self.shared.state();
            if state.jobs.get(&number).is_some_and(|live| !live.row.state.ended()) {
                continue;
            }
            state.jobs.remove(&number);
            forgotten += usize::from(self.shared.store.remove_job(number)?);
        }
        Ok(forgotten)
    }

    /// Events of a job after event number `after` (0 for all).
    pub fn watch(&self, id: &str, after: u64) -> Result<Watcher> {
        Watcher::new(self.shared.clone(), id, after)
    }

    /// Stops the jobs; unfinished ones are queued in the store for the next runner. Waits for their threads up to `patience`; work
    /// that does not notice the stop by then is abandoned.
    pub fn stop(&self, patience: Duration) {
        if !self.shared.stopping.swap(true, Ordering::SeqCst) {
            let mut state = self.shared.state();
            state.queue.clear();
            for (number, live) in &state.jobs {
                if live.row.state == JobState::Running
                    && let Err(e) = self.shared.store.put_back_job(*number)
                {
                    tracing::error!("job {number} could not be put back: {e}");
                }
            }
        }
        let deadline = Instant::now() + patience;
        while self.is_running() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Runner {
    fn drop(&mut self) {
        self.stop(Duration::from_secs(10));
    }
}
