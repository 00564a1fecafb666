//! Queues, watches and stops jobs: the interface of the job module.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::active::ActiveJob;
use super::record::{DeleteOutcome, Job, number, unknown};
use super::state::{OnJobEnd, RunnerConfig, RunnerState, SCARCE_START_WEIGHT};
use super::watch::Watcher;
use super::work::WorkFactories;
use crate::error::{Error, Result};
use crate::store::{JobList, JobRow, JobState, LogRow, Store, StoredResponse};

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
            config: RwLock::new(config),
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
        *self.shared.config.write().unwrap_or_else(PoisonError::into_inner) = config;
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

    /// Cancels a job that has not ended; removes one that has.
    pub fn delete(&self, id: &str) -> Result<DeleteOutcome> {
        let number = number(id)?;
        let mut state = self.shared.state();
        if let Some(live) = state.jobs.get_mut(&number)
            && !live.row.state.ended()
        {
            // At once: a large plan takes a while to store.
            live.cancel.store(true, Ordering::SeqCst);
            self.shared.store.cancel_job(number)?;
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
        while self.shared.threads.load(Ordering::SeqCst) > 0 && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Runner {
    fn drop(&mut self) {
        self.stop(Duration::from_secs(10));
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::{LazyLock, mpsc};

    use serde_json::json;

    use super::*;
    use crate::job::MAX_STARTS_WITHOUT_PROGRESS;
    use crate::job::record::id;
    use crate::job::work::{JobContext, WorkFactory, WorkOutcome};
    use crate::progress::Progress;

    /// Work of the test's jobs, by name; a job's plan is the name.
    type Acts = BTreeMap<&'static str, fn(&JobContext, &Store) -> Result<WorkOutcome>>;

    /// A runner with one worker. Work signals on the channel that it has started.
    fn runner_on(store: &Arc<Store>, queue: usize) -> (Runner, mpsc::Receiver<()>) {
        let (begun, wait) = mpsc::channel();
        let of = store.clone();
        let work_factory: WorkFactory = Box::new(move |plan| {
            let (act, begun, store) = (ACTS[plan.as_str().unwrap()], begun.clone(), of.clone());
            Ok(Box::new(move |context| {
                let _ = begun.send(());
                act(context, &store)
            }))
        });
        let explain = |e: &Error| json!({"detail": e.to_string()});
        let config =
            RunnerConfig { running: 1, queue, owner_queue: queue, threads: 1, max_run_time: None, explain };
        (
            Runner::start(
                store.clone(),
                WorkFactories::from([("act", work_factory)]),
                config,
                Box::new(|_| {}),
            )
            .unwrap(),
            wait,
        )
    }

    fn runner(queue: usize) -> (Runner, mpsc::Receiver<()>) {
        runner_on(&Arc::new(Store::in_memory().unwrap()), queue)
    }

    static ACTS: LazyLock<Acts> = LazyLock::new(|| {
        Acts::from([
            (
                "count",
                (|c, _| {
                    for i in 0..=4 {
                        c.report("counting", i, 4)?;
                    }
                    Ok(WorkOutcome::Done(json!({ "id": c.id })))
                }) as fn(&JobContext, &Store) -> Result<WorkOutcome>,
            ),
            ("endless", |c, _| {
                loop {
                    c.report("waiting", 0, 1)?;
                    std::thread::yield_now();
                }
            }),
            ("one", |_, _| Ok(WorkOutcome::Done(json!(1)))),
            ("panics", |_, _| panic!("defect")),
            ("fails", |_, _| Err(Error::Failed("no".into()))),
            ("asks", |c, store| {
                // Waits for results twice.
                let before = store.rounds(c.number)?.len() as u64;
                store.open_round(c.number, before, "")?;
                Ok(if before < 2 { WorkOutcome::Waiting } else { WorkOutcome::Done(json!(before)) })
            }),
        ])
    });

    fn submit(runner: &Runner, act: &str) -> Result<Job> {
        runner.submit(
            JobSpec { kind: "act", config: &json!({}), plan: &json!(act), seed: 0 },
            None,
            "",
            &|_| None,
        )
    }

    /// Waits until the job is in this state.
    fn reach(runner: &Runner, id: &str, state: JobState) -> Job {
        loop {
            let job = runner.get(id).unwrap();
            if job.row.state == state {
                return job;
            }
            assert!(!job.row.state.ended(), "{job:?}");
            std::thread::yield_now();
        }
    }

    /// All events after `after`, to the end.
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
    fn replays_events_from_id() {
        let (runner, _) = runner(4);
        let job = submit(&runner, "count").unwrap();
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
        assert_eq!(events(&runner, &job.id, 1000), all, "a number of before a restart");
        assert!(runner.watch(&job.id, all.len() as u64).unwrap().exhausted());
        assert_eq!(runner.get(&job.id).unwrap(), all.last().unwrap().1);
    }

    #[test]
    fn log_continues_over_restart() {
        let store = Arc::new(Store::in_memory().unwrap());
        let (first, begun) = runner_on(&store, 4);
        let job = submit(&first, "endless").unwrap();
        begun.recv().unwrap();
        while first.log(&job.id, 0, 9).unwrap().len() < 3 {
            std::thread::yield_now();
        }
        first.stop(Duration::from_secs(60));
        let (second, begun) = runner_on(&store, 4);
        begun.recv().unwrap();
        while second.log(&job.id, 0, 9).unwrap().len() < 7 {
            std::thread::yield_now();
        }
        second.delete(&job.id).unwrap();
        assert_eq!(events(&second, &job.id, 0).last().unwrap().1.row.state, JobState::Cancelled);
        let log_texts = |id: &str, after| -> Vec<String> {
            second.log(id, after, 99).unwrap().into_iter().map(|l| l.text).collect()
        };
        let all = log_texts(&job.id, 0);
        let parts = [
            &["queued", "started", "waiting", "the server stops; the next one resumes the job"][..],
            &[
                "the server was started: the job is queued again",
                "started",
                "waiting",
                "cancellation requested",
                "cancelled",
            ][..],
        ];
        assert_eq!(all, parts.concat());
        assert_eq!(log_texts(&job.id, 3), all[3..]);
        let failed = submit(&second, "fails").unwrap();
        events(&second, &failed.id, 0);
        assert_eq!(log_texts(&failed.id, 0).last().unwrap(), "failed: no");
        second.delete(&failed.id).unwrap();
        assert!(log_texts(&failed.id, 0).is_empty());
    }

    #[test]
    fn cancels_jobs_and_bounds_queue() {
        let (runner, begun) = runner(1);
        let running = submit(&runner, "endless").unwrap();
        begun.recv().unwrap();
        let queued = submit(&runner, "one").unwrap();
        assert!(matches!(submit(&runner, "one"), Err(Error::Capacity { limit: 1, .. })));
        assert!(
            matches!(runner.delete(&queued.id).unwrap(), DeleteOutcome::Cancelled(j) if j.row.state == JobState::Cancelled)
        );
        assert!(matches!(runner.delete(&running.id).unwrap(), DeleteOutcome::Cancelled(_)));
        assert_eq!(events(&runner, &running.id, 0).last().unwrap().1.row.state, JobState::Cancelled);
        assert_eq!(runner.delete(&running.id).unwrap(), DeleteOutcome::Removed);
        assert!(
            runner.get(&running.id).is_err()
                && runner.delete("job-7").is_err()
                && runner.get("job-+1").is_err()
        );
    }

    #[test]
    fn panic_fails_the_job_only() {
        let (runner, _) = runner(4);
        for (act, word) in [("panics", "panicked"), ("fails", "no")] {
            let job = submit(&runner, act).unwrap();
            let end = events(&runner, &job.id, 0).pop().unwrap().1.row;
            assert_eq!(end.state, JobState::Failed);
            assert!(end.error.unwrap()["detail"].as_str().unwrap().contains(word));
        }
    }

    #[test]
    fn next_runner_resumes_stopped_jobs() {
        let store = Arc::new(Store::in_memory().unwrap());
        let (first, begun) = runner_on(&store, 4);
        let running = submit(&first, "endless").unwrap();
        begun.recv().unwrap();
        let queued = submit(&first, "one").unwrap();
        first.stop(Duration::from_secs(60));
        assert!(submit(&first, "one").is_err());
        let row = store.job(1).unwrap().unwrap();
        assert_eq!((row.state, row.starts), (JobState::Queued, 0), "a stop is not held against it");
        let (second, begun) = runner_on(&store, 4);
        begun.recv().unwrap();
        assert_eq!(second.get(&running.id).unwrap().row.state, JobState::Running);
        second.delete(&running.id).unwrap();
        assert_eq!(reach(&second, &queued.id, JobState::Succeeded).row.result, Some(json!(1)));
    }

    #[test]
    fn removes_old_ended_jobs_with_artifacts() {
        let store = Arc::new(Store::in_memory().unwrap());
        let (runner, begun) = runner_on(&store, 4);
        let done = submit(&runner, "one").unwrap();
        let number = reach(&runner, &done.id, JobState::Succeeded).row.number;
        store.put_artifact(number, "surface", b"s").unwrap();
        begun.recv().unwrap();
        let running = submit(&runner, "endless").unwrap();
        begun.recv().unwrap();
        assert_eq!(runner.remove_ended(1).unwrap(), 0, "it ended after that");
        assert_eq!(runner.remove_ended(u64::MAX >> 1).unwrap(), 1);
        assert!(runner.get(&done.id).is_err() && store.artifact(number, "surface").unwrap().is_none());
        assert_eq!(runner.get(&running.id).unwrap().row.state, JobState::Running);
        runner.delete(&running.id).unwrap();
    }

    #[test]
    fn fails_job_after_repeated_starts_without_progress() {
        let store = Arc::new(Store::in_memory().unwrap());
        let add = |act: &str| {
            let row = store.add_job("act", &json!({}), &json!(act), 0, None, &|_| None).unwrap();
            (0..MAX_STARTS_WITHOUT_PROGRESS).for_each(|_| store.begin_job(row.number).unwrap());
            row.number
        };
        let (stuck, moving) = (add("one"), add("one"));
        store.open_round(moving, 0, "").unwrap();
        let gone = store.add_job("knitting", &json!({}), &json!(1), 0, None, &|_| None).unwrap().number;
        let (runner, _) = runner_on(&store, 4);
        reach(&runner, &id(moving), JobState::Succeeded);
        for (number, word) in [(stuck, "5 times"), (gone, "start it again")] {
            let row = store.job(number).unwrap().unwrap();
            assert_eq!(row.state, JobState::Failed);
            assert!(row.error.unwrap()["detail"].as_str().unwrap().contains(word));
        }
    }

    #[test]
    fn fails_job_that_twice_ended_the_server_by_memory() {
        let store = Arc::new(Store::in_memory().unwrap());
        for lost in 0..2 {
            let (runner, begun) = runner_on(&store, 4);
            if lost == 0 {
                submit(&runner, "endless").unwrap();
            }
            begun.recv().unwrap();
            runner.note_scarce_memory().unwrap();
            runner.note_scarce_memory().unwrap();
            let starts = store.job(1).unwrap().unwrap().starts;
            assert_eq!(starts, SCARCE_START_WEIGHT * (lost + 1));
            runner.stop(Duration::from_secs(60));
            // A kill would not have put it back.
            (0..starts - store.job(1).unwrap().unwrap().starts).for_each(|_| store.begin_job(1).unwrap());
        }
        let (runner, _) = runner_on(&store, 4);
        assert_eq!(runner.get("job-1").unwrap().row.state, JobState::Failed);
    }

    #[test]
    fn waiting_job_survives_restart_without_worker() {
        let store = Arc::new(Store::in_memory().unwrap());
        let (first, _) = runner_on(&store, 4);
        let job = submit(&first, "asks").unwrap();
        reach(&first, &job.id, JobState::Waiting);
        let other = submit(&first, "one").unwrap();
        reach(&first, &other.id, JobState::Succeeded);
        assert_eq!(first.report_results(&job.id, 1, 2).unwrap().row.state, JobState::Waiting);
        drop(first);
        let (second, _) = runner_on(&store, 4);
        assert_eq!(second.get(&job.id).unwrap().row.state, JobState::Waiting);
        assert_eq!(second.report_results(&job.id, 2, 2).unwrap().row.state, JobState::Queued);
        while store.rounds(1).unwrap().len() < 2 {
            std::thread::yield_now();
        }
        reach(&second, &job.id, JobState::Waiting);
        second.report_results(&job.id, 2, 2).unwrap();
        assert_eq!(reach(&second, &job.id, JobState::Succeeded).row.result, Some(json!(2)));
        // A waiting job can be cancelled.
        let job = submit(&second, "asks").unwrap();
        reach(&second, &job.id, JobState::Waiting);
        assert!(
            matches!(second.delete(&job.id).unwrap(), DeleteOutcome::Cancelled(j) if j.row.state.ended())
        );
    }
}
