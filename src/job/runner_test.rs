//! Jobs from submission to end, over restarts of the runner.

use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock, mpsc};
use std::time::Duration;

use serde_json::json;

use super::record::{DeleteOutcome, Job, id};
use super::runner::{JobSpec, Runner};
use super::state::{MAX_STARTS_WITHOUT_PROGRESS, RunnerConfig, SCARCE_START_WEIGHT};
use super::work::{JobContext, WorkFactories, WorkFactory, WorkOutcome};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::store::{JobState, Store};

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
        Runner::start(store.clone(), WorkFactories::from([("act", work_factory)]), config, Box::new(|_| {}))
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
    runner
        .submit(JobSpec { kind: "act", config: &json!({}), plan: &json!(act), seed: 0 }, None, "", &|_| None)
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
    assert_eq!(all.iter().map(|(n, _)| *n).collect::<Vec<_>>(), (1..=all.len() as u64).collect::<Vec<_>>());
    assert_eq!(events(&runner, &job.id, 3), all[3..]);
    assert_eq!(events(&runner, &job.id, all.len() as u64), []);
    assert_eq!(events(&runner, &job.id, 1000), all, "a number of before a restart");
    assert!(runner.watch(&job.id, all.len() as u64).unwrap().exhausted());
    assert_eq!(runner.get(&job.id).unwrap(), all.last().unwrap().1);
}

#[test]
fn events_have_the_times_of_their_moment() {
    let (runner, _) = runner(4);
    let job = submit(&runner, "count").unwrap();
    let created = job.row.metadata.created;
    assert!(created.is_some());
    let times: Vec<_> = events(&runner, &job.id, 0).into_iter().map(|(_, job)| job.row.metadata).collect();
    let last = times.last().unwrap();
    assert!(created <= last.started && last.started <= last.ended, "{last:?}");
    assert!(times.iter().all(|at| at.created == created));
    assert_eq!((times[0].started, times[0].ended), (None, None));
    assert_eq!((times[1].started, times[1].ended), (last.started, None));
    let cancelled = submit(&runner, "endless").unwrap();
    runner.delete(&cancelled.id).unwrap();
    assert!(reach(&runner, &cancelled.id, JobState::Cancelled).row.metadata.ended.is_some());
}

#[test]
fn annotations_reach_memory_and_store() {
    let store = Arc::new(Store::in_memory().unwrap());
    let (runner, begun) = runner_on(&store, 4);
    let job = submit(&runner, "endless").unwrap();
    begun.recv().unwrap();
    let texts = |job: Job| (job.row.metadata.name, job.row.metadata.note);
    let named = runner.annotate(&job.id, Some("felt"), None).unwrap();
    assert_eq!(texts(named), ("felt".into(), String::new()));
    let noted = runner.annotate(&job.id, None, Some("lights on")).unwrap();
    assert_eq!((noted.row.state, texts(noted)), (JobState::Running, ("felt".into(), "lights on".into())));
    runner.stop(Duration::from_secs(60));
    let (runner, begun) = runner_on(&store, 4);
    begun.recv().unwrap();
    let resumed = runner.get(&job.id).unwrap();
    assert!(resumed.row.metadata.started.is_some());
    assert_eq!(texts(resumed), ("felt".into(), "lights on".into()));
    runner.delete(&job.id).unwrap();
    reach(&runner, &job.id, JobState::Cancelled);
    // An ended job, in memory and in the store.
    assert_eq!(texts(runner.annotate(&job.id, Some(""), None).unwrap()), (String::new(), "lights on".into()));
    assert_eq!(store.job(1).unwrap().unwrap().metadata, runner.get(&job.id).unwrap().row.metadata);
    assert!(matches!(runner.annotate("job-9", Some("x"), None), Err(Error::NotFound { .. })));
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
        runner.get(&running.id).is_err() && runner.delete("job-7").is_err() && runner.get("job-+1").is_err()
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
        (0..MAX_STARTS_WITHOUT_PROGRESS).for_each(|_| store.begin_job(row.number, 5).unwrap());
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
        (0..starts - store.job(1).unwrap().unwrap().starts).for_each(|_| store.begin_job(1, 5).unwrap());
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
    assert!(matches!(second.delete(&job.id).unwrap(), DeleteOutcome::Cancelled(j) if j.row.state.ended()));
}
