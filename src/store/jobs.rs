//! Jobs as rows.

use std::collections::BTreeMap;

use rusqlite::types::ValueRef;
use rusqlite::{Row, params};
use serde::Deserialize;
use serde_json::Value;

use super::clock::unix_ms;
use super::job_metadata::{self, JobMetadata};
use super::requests::{StoredResponse, keep};
use super::schema::TABLES_OF_JOB;
use super::{Store, checksum, json, query, sql};
use crate::error::Result;
use crate::names::names;

/// A stored job.
#[derive(Clone, Debug, PartialEq)]
pub struct JobRow {
    /// Unique, also over restarts and removals.
    pub number: i64,
    pub kind: String,
    pub state: JobState,
    /// The request, as its owner wrote it.
    pub config: Value,
    /// The resolved request, enough to start the job again. Not shown: it may hold a real world's latents.
    pub plan: Value,
    /// Starts since the last progress.
    pub starts: u32,
    pub result: Option<Value>,
    /// The error in the form shown to its owner.
    pub error: Option<Value>,
    pub seed: u64,
    /// Version of the program that ran it.
    pub version: String,
    pub stage: String,
    pub done: u64,
    pub total: u64,
    /// Id of its last event.
    pub events: u64,
    /// Name of the token that queued it.
    pub owner: Option<String>,
    pub metadata: JobMetadata,
}

/// Filter and order of a list of jobs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JobList {
    /// Newest first instead of oldest first.
    pub newest: bool,
    /// Only jobs in this state.
    pub state: Option<JobState>,
    /// Only jobs of this kind.
    pub kind: Option<String>,
    /// Without results, which may be large.
    pub bare: bool,
}

impl JobRow {
    /// Size as JSON, bytes.
    pub fn size(&self) -> usize {
        let parts = [Some(&self.config), Some(&self.plan), self.result.as_ref(), self.error.as_ref()];
        let values: usize = parts.into_iter().flatten().map(|value| value.to_string().len()).sum();
        values + self.metadata.name.len() + self.metadata.note.len()
    }
}

/// State of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    Queued,
    Running,
    /// Waiting for results of its proposals; nothing runs.
    Waiting,
    Succeeded,
    Failed,
    Cancelled,
}

impl Store {
    /// Adds a queued job; stores the response built by `answered` in the same transaction.
    pub fn add_job(
        &self,
        kind: &str,
        config: &Value,
        plan: &Value,
        seed: u64,
        owner: Option<&str>,
        answered: &dyn Fn(&JobRow) -> Option<StoredResponse>,
    ) -> Result<JobRow> {
        let version = env!("CARGO_PKG_VERSION");
        self.atomically(|t| {
            t.execute(
                "INSERT INTO job (kind, state, config, plan, seed, version, events, owner) \
                 VALUES (?1, 'queued', ?2, ?3, ?4, ?5, 1, ?6)",
                params![kind, config.to_string(), plan.to_string(), seed.to_string(), version, owner],
            )?;
            let row = JobRow {
                number: t.last_insert_rowid(),
                kind: kind.into(),
                state: JobState::Queued,
                config: config.clone(),
                plan: plan.clone(),
                starts: 0,
                result: None,
                error: None,
                seed,
                version: version.into(),
                stage: String::new(),
                done: 0,
                total: 0,
                events: 1,
                owner: owner.map(String::from),
                metadata: JobMetadata { created: Some(unix_ms()), ..JobMetadata::default() },
            };
            job_metadata::insert(t, row.number, &row.metadata)?;
            keep(t, answered(&row).as_ref())?;
            Ok(row)
        })
    }

    /// Stores a job's state, progress, result, error, times and summary.
    pub fn update_job(&self, job: &JobRow) -> Result<()> {
        let json = |value: &Option<Value>| value.as_ref().map(Value::to_string);
        let (result, error) = (json(&job.result), json(&job.error));
        self.atomically(|t| {
            t.execute(
                "UPDATE job SET state = ?2, result = ?3, error = ?4, stage = ?5, done = ?6, total = ?7, events = ?8 \
                 WHERE number = ?1",
                params![
                    job.number,
                    job.state.name(),
                    result,
                    error,
                    job.stage,
                    job.done as i64,
                    job.total as i64,
                    job.events as i64,
                ],
            )?;
            job_metadata::update(t, job.number, &job.metadata)
        })
    }

    /// Stores that a job runs, and counts the start; `at`, ms since 1970, is the time of its first start.
    pub fn begin_job(&self, number: i64, at: u64) -> Result<()> {
        let begin = format!("started = coalesce(started, {at})");
        self.move_job(number, "state = 'running', starts = starts + 1", Some(&begin))
    }

    /// Counts the present start of a job as `weight` starts.
    pub fn weigh_start(&self, number: i64, weight: u32) -> Result<()> {
        self.move_job(number, &format!("starts = starts + {}", weight.saturating_sub(1)), None)
    }

    /// Stores that a job is queued again; its last start does not count, since the job did not cause the stop.
    pub fn put_back_job(&self, number: i64) -> Result<()> {
        self.move_job(number, "state = 'queued', starts = max(starts - 1, 0)", None)
    }

    /// Stores that a job is cancelled at a time, ms since 1970, whether or not it has noticed.
    pub fn cancel_job(&self, number: i64, at: u64) -> Result<()> {
        self.move_job(number, "state = 'cancelled'", Some(&format!("ended = {at}")))
    }

    /// Updates a job that has not ended, and its metadata.
    fn move_job(&self, number: i64, set: &str, set_metadata: Option<&str>) -> Result<()> {
        let open = "state IN ('queued', 'running', 'waiting')";
        self.atomically(|t| {
            let found =
                t.execute(&format!("UPDATE job SET {set} WHERE number = ?1 AND {open}"), [number])? > 0;
            match set_metadata {
                Some(set) if found => {
                    t.execute(&format!("UPDATE metadata SET {set} WHERE job = ?1"), [number]).map(drop)
                }
                _ => Ok(()),
            }
        })
    }

    /// The job with this number.
    pub fn job(&self, number: i64) -> Result<Option<JobRow>> {
        self.row(&format!("SELECT {} FROM {ROWS} WHERE number = ?1", columns()), [number], row)
    }

    /// At most `limit` jobs after number `after` in the requested order, of one owner or of all.
    pub fn jobs(
        &self,
        list: &JobList,
        after: Option<i64>,
        limit: usize,
        owner: Option<&str>,
    ) -> Result<Vec<JobRow>> {
        let (later, order) = if list.newest { ("<", "DESC") } else { (">", "ASC") };
        let which = format!(
            "WHERE (?1 IS NULL OR number {later} ?1) AND (?3 IS NULL OR owner = ?3) AND (?4 IS NULL OR state = ?4) \
             AND (?5 IS NULL OR kind = ?5) ORDER BY number {order} LIMIT ?2"
        );
        let with = params![after, limit as i64, owner, list.state.map(JobState::name), list.kind];
        let columns = if list.bare { columns().replace("result", "NULL") } else { columns() };
        self.select(&columns, &which, with)
    }

    /// All jobs that have not ended, by number.
    pub fn unfinished(&self) -> Result<Vec<JobRow>> {
        self.select(&columns(), "WHERE state IN ('queued', 'running', 'waiting') ORDER BY number", [])
    }

    /// Number of jobs by state.
    pub fn jobs_by_state(&self) -> Result<BTreeMap<String, u64>> {
        let select = "SELECT state, count(*) FROM job GROUP BY state";
        let row = |r: &Row| Ok((r.get(0)?, r.get::<_, i64>(1)? as u64));
        Ok(query(&self.connection(), select, [], row).map_err(sql)?.into_iter().collect())
    }

    /// Removes a job with its rounds, measurements, artifacts, log and metadata; whether it existed.
    pub fn remove_job(&self, number: i64) -> Result<bool> {
        self.atomically(|t| {
            for table in TABLES_OF_JOB {
                t.execute(&format!("DELETE FROM {table} WHERE job = ?1"), [number])?;
            }
            t.execute("DELETE FROM job WHERE number = ?1", [number]).map(|n| n > 0)
        })
    }

    fn select(&self, columns: &str, which: &str, with: impl rusqlite::Params) -> Result<Vec<JobRow>> {
        self.rows(&format!("SELECT {columns} FROM {ROWS} {which}"), with, row)
    }
}

/// Jobs with their metadata, intact if both are.
const ROWS: &str = "whole_job LEFT JOIN \
    (SELECT job, name, note, created, started, ended AS metadata_ended, summary, whole AS metadata_whole, \
     record AS metadata_record FROM whole_metadata) ON job = number";

/// The columns that [`row`] reads.
fn columns() -> String {
    format!(
        "number, kind, state, config, result, error, seed, version, stage, done, total, events, plan, starts, owner, {}, \
         whole AND coalesce(metadata_whole, TRUE) AS whole, iif(coalesce(metadata_whole, TRUE), record, metadata_record) AS record",
        job_metadata::COLUMNS
    )
}

fn row(row: &Row) -> rusqlite::Result<JobRow> {
    let text = |i: usize| row.get::<_, String>(i);
    let optional = |i: usize| match row.get_ref(i)? {
        ValueRef::Null => Ok::<_, rusqlite::Error>(None),
        _ => json(row, i).map(Some),
    };
    let count = |i: usize| Ok::<_, rusqlite::Error>(row.get::<_, i64>(i)? as u64);
    let state = text(2)?;
    Ok(JobRow {
        number: row.get(0)?,
        kind: text(1)?,
        state: JobState::named(&state)
            .ok_or_else(|| checksum::unreadable(row, &format!("there is no state {state:?}")))?,
        config: json(row, 3)?,
        result: optional(4)?,
        error: optional(5)?,
        seed: text(6)?.parse().map_err(|_| checksum::unreadable(row, "its seed is not a number"))?,
        version: text(7)?,
        stage: text(8)?,
        done: count(9)?,
        total: count(10)?,
        events: count(11)?,
        plan: optional(12)?.unwrap_or_default(),
        starts: row.get(13)?,
        owner: row.get(14)?,
        metadata: job_metadata::from_columns(row, 15)?,
    })
}

names!(JobState: Queued = "queued", Running = "running", Waiting = "waiting",
    Succeeded = "succeeded", Failed = "failed", Cancelled = "cancelled");

impl JobState {
    /// Whether the state is final.
    pub fn ended(self) -> bool {
        matches!(self, JobState::Succeeded | JobState::Failed | JobState::Cancelled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn add(store: &Store, kind: &str, seed: u64) -> JobRow {
        store.add_job(kind, &json!({"a": 1}), &json!({"b": 2}), seed, None, &|_| None).unwrap()
    }

    #[test]
    fn jobs_survive_and_unfinished_ones_are_listed() {
        let dir = tempfile::tempdir().unwrap();
        let (done, open) = {
            let store = Store::open(dir.path()).unwrap();
            let mut done = add(&store, "iplw", u64::MAX);
            (done.state, done.result, done.events) = (JobState::Succeeded, Some(json!([1.5])), 3);
            store.update_job(&done).unwrap();
            let mut open = add(&store, "train", 1);
            store.begin_job(open.number, 5).unwrap();
            store.begin_job(open.number, 7).unwrap();
            store.put_back_job(open.number).unwrap();
            (open.state, open.starts, open.metadata.started) = (JobState::Waiting, 1, Some(5));
            store.update_job(&open).unwrap();
            (done, open)
        };
        let store = Store::open(dir.path()).unwrap();
        assert_eq!(store.job(done.number).unwrap().unwrap(), done);
        assert_eq!(store.unfinished().unwrap(), std::slice::from_ref(&open));
        let counts = store.jobs_by_state().unwrap();
        assert_eq!(counts, BTreeMap::from([("succeeded".into(), 1), ("waiting".into(), 1)]));
        let list = JobList::default();
        let newest = JobList { newest: true, ..list.clone() };
        assert_eq!(store.jobs(&list, None, 1, None).unwrap(), std::slice::from_ref(&done));
        assert_eq!(store.jobs(&list, Some(1), 9, None).unwrap(), std::slice::from_ref(&open));
        assert_eq!(store.jobs(&newest, None, 1, None).unwrap(), std::slice::from_ref(&open));
        assert_eq!(store.jobs(&newest, Some(2), 9, None).unwrap(), std::slice::from_ref(&done));
        let waiting = JobList { state: Some(JobState::Waiting), ..list.clone() };
        assert_eq!(store.jobs(&waiting, None, 9, None).unwrap(), std::slice::from_ref(&open));
        let trainings = JobList { kind: Some("train".into()), ..list.clone() };
        assert_eq!(store.jobs(&trainings, None, 9, None).unwrap(), std::slice::from_ref(&open));
        let bare = JobList { bare: true, ..list };
        assert_eq!(store.jobs(&bare, None, 9, None).unwrap(), [JobRow { result: None, ..done }, open]);
    }

    #[test]
    fn only_ended_jobs_have_end_time() {
        let store = Store::in_memory().unwrap();
        let (mut done, gone, open) = (add(&store, "iplw", 1), add(&store, "iplw", 2), add(&store, "iplw", 3));
        store.begin_job(open.number, 5).unwrap();
        assert!(store.ended_before(i64::MAX as u64).unwrap().is_empty());
        (done.state, done.metadata.ended) = (JobState::Succeeded, Some(6_500));
        store.update_job(&done).unwrap();
        store.cancel_job(gone.number, 7_000).unwrap();
        store.cancel_job(gone.number, 9_000).unwrap();
        assert_eq!(store.ended_before(i64::MAX as u64).unwrap(), [done.number, gone.number]);
        assert_eq!(store.ended_before(7).unwrap(), [done.number]);
        assert!(store.ended_before(6).unwrap().is_empty());
    }

    #[test]
    fn numbers_are_not_reused() {
        let store = Store::in_memory().unwrap();
        let first = add(&store, "iplw", 0).number;
        assert!(store.remove_job(first).unwrap());
        assert!(!store.remove_job(first).unwrap());
        assert_ne!(add(&store, "iplw", 0).number, first);
    }
}
