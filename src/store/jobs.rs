//! Jobs as rows.

use std::collections::BTreeMap;

use rusqlite::{OptionalExtension, Row, params};
use serde_json::Value;

use super::requests::{Answered, keep};
use super::{Store, json, sql};
use crate::error::Result;

/// One job as stored.
#[derive(Clone, Debug, PartialEq)]
pub struct JobRow {
    /// Never used twice, restarts included.
    pub number: i64,
    pub kind: String,
    pub state: JobState,
    /// What was asked for, as its owner wrote it.
    pub config: Value,
    /// The same with everything decided: enough to start it again. Not shown; it may hold a real world's secrets.
    pub plan: Value,
    /// How often it was begun since it last got anywhere.
    pub starts: u32,
    pub result: Option<Value>,
    /// Why it failed, in the form its owner was told.
    pub error: Option<Value>,
    pub seed: u64,
    /// Version of the program that ran it.
    pub version: String,
    pub stage: String,
    pub done: u64,
    pub total: u64,
    /// Id of its last event.
    pub events: u64,
    /// Name of the token it was queued with.
    pub owner: Option<String>,
}

impl JobRow {
    /// What it takes as JSON, bytes.
    pub fn size(&self) -> usize {
        let parts = [Some(&self.config), Some(&self.plan), self.result.as_ref(), self.error.as_ref()];
        parts.into_iter().flatten().map(|value| value.to_string().len()).sum()
    }
}

/// Where a job stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JobState {
    Queued,
    Running,
    /// For answers to what it proposed; nothing is worked on.
    Waiting,
    Succeeded,
    Failed,
    Cancelled,
}

impl Store {
    /// Takes in a queued job and numbers it; in the same transaction keeps what `answered` makes of it.
    pub fn add_job(
        &self,
        kind: &str,
        config: &Value,
        plan: &Value,
        seed: u64,
        owner: Option<&str>,
        answered: &dyn Fn(&JobRow) -> Option<Answered>,
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
            };
            keep(t, answered(&row).as_ref())?;
            Ok(row)
        })
    }

    /// Writes a job's state, progress, result and error.
    pub fn update_job(&self, job: &JobRow) -> Result<()> {
        self.connection()
            .execute(
                "UPDATE job SET state = ?2, result = ?3, error = ?4, stage = ?5, done = ?6, total = ?7, \
                 events = ?8 WHERE number = ?1",
                params![
                    job.number,
                    job.state.name(),
                    job.result.as_ref().map(Value::to_string),
                    job.error.as_ref().map(Value::to_string),
                    job.stage,
                    job.done as i64,
                    job.total as i64,
                    job.events as i64,
                ],
            )
            .map(drop)
            .map_err(sql)
    }

    /// Writes that a job runs, one start more.
    pub fn begin_job(&self, number: i64) -> Result<()> {
        self.move_job(number, "state = 'running', starts = starts + 1")
    }

    /// Writes that a job is queued again though it did nothing wrong: its last start does not count.
    pub fn put_back_job(&self, number: i64) -> Result<()> {
        self.move_job(number, "state = 'queued', starts = max(starts - 1, 0)")
    }

    /// Writes that a job is cancelled, whether or not it has noticed yet.
    pub fn cancel_job(&self, number: i64) -> Result<()> {
        self.move_job(number, "state = 'cancelled'")
    }

    /// Changes a job that has not ended.
    fn move_job(&self, number: i64, set: &str) -> Result<()> {
        let open = "state IN ('queued', 'running', 'waiting')";
        self.connection()
            .execute(&format!("UPDATE job SET {set} WHERE number = ?1 AND {open}"), [number])
            .map(drop)
            .map_err(sql)
    }

    /// The job with this number.
    pub fn job(&self, number: i64) -> Result<Option<JobRow>> {
        self.connection()
            .query_row(&format!("SELECT {COLUMNS} FROM job WHERE number = ?1"), [number], row)
            .optional()
            .map_err(sql)
    }

    /// At most `limit` jobs in order of number, those after number `after`; one owner's, or everybody's.
    pub fn jobs(&self, after: i64, limit: usize, owner: Option<&str>) -> Result<Vec<JobRow>> {
        let which = "WHERE number > ?1 AND (?3 IS NULL OR owner = ?3) ORDER BY number LIMIT ?2";
        self.select(which, params![after, limit as i64, owner])
    }

    /// Every job that has not ended, in order of number.
    pub fn unfinished(&self) -> Result<Vec<JobRow>> {
        self.select("WHERE state IN ('queued', 'running', 'waiting') ORDER BY number", [])
    }

    /// How many jobs are in each state that any is in.
    pub fn jobs_by_state(&self) -> Result<BTreeMap<String, u64>> {
        let c = self.connection();
        let mut query = c.prepare("SELECT state, count(*) FROM job GROUP BY state").map_err(sql)?;
        let rows = query.query_map([], |r| Ok((r.get(0)?, r.get::<_, i64>(1)? as u64))).map_err(sql)?;
        rows.collect::<rusqlite::Result<_>>().map_err(sql)
    }

    /// Forgets a job and everything measured, found and left by it; whether there was one.
    pub fn remove_job(&self, number: i64) -> Result<bool> {
        self.atomically(|t| {
            for table in ["round", "measured", "artifact"] {
                t.execute(&format!("DELETE FROM {table} WHERE job = ?1"), [number])?;
            }
            t.execute("DELETE FROM job WHERE number = ?1", [number]).map(|n| n > 0)
        })
    }

    fn select(&self, which: &str, with: impl rusqlite::Params) -> Result<Vec<JobRow>> {
        let c = self.connection();
        let mut query = c.prepare(&format!("SELECT {COLUMNS} FROM job {which}")).map_err(sql)?;
        let rows = query.query_map(with, row).map_err(sql)?;
        rows.collect::<rusqlite::Result<_>>().map_err(sql)
    }
}

const COLUMNS: &str = "number, kind, state, config, result, error, seed, version, stage, done, total, events, plan, starts, owner";

fn row(row: &Row) -> rusqlite::Result<JobRow> {
    let text = |i: usize| row.get::<_, String>(i);
    let optional = |i: usize| Ok::<_, rusqlite::Error>(row.get::<_, Option<String>>(i)?.map(|t| json(&t)));
    let count = |i: usize| Ok::<_, rusqlite::Error>(row.get::<_, i64>(i)? as u64);
    Ok(JobRow {
        number: row.get(0)?,
        kind: text(1)?,
        state: JobState::from_name(&text(2)?),
        config: json(&text(3)?),
        result: optional(4)?,
        error: optional(5)?,
        seed: text(6)?.parse().unwrap_or(0),
        version: text(7)?,
        stage: text(8)?,
        done: count(9)?,
        total: count(10)?,
        events: count(11)?,
        plan: optional(12)?.unwrap_or_default(),
        starts: row.get(13)?,
        owner: row.get(14)?,
    })
}

impl JobState {
    /// Every state.
    pub const ALL: [JobState; 6] = [
        JobState::Queued,
        JobState::Running,
        JobState::Waiting,
        JobState::Succeeded,
        JobState::Failed,
        JobState::Cancelled,
    ];

    /// The name used in files and on the wire.
    pub fn name(self) -> &'static str {
        match self {
            JobState::Queued => "queued",
            JobState::Running => "running",
            JobState::Waiting => "waiting",
            JobState::Succeeded => "succeeded",
            JobState::Failed => "failed",
            JobState::Cancelled => "cancelled",
        }
    }

    /// Whether nothing more will happen to the job.
    pub fn ended(self) -> bool {
        matches!(self, JobState::Succeeded | JobState::Failed | JobState::Cancelled)
    }

    fn from_name(name: &str) -> JobState {
        JobState::ALL.into_iter().find(|s| s.name() == name).unwrap_or(JobState::Failed)
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
    fn jobs_survive_and_those_not_ended_are_found() {
        let dir = tempfile::tempdir().unwrap();
        let (done, open) = {
            let store = Store::open(dir.path()).unwrap();
            let mut done = add(&store, "iplw", u64::MAX);
            (done.state, done.result, done.events) = (JobState::Succeeded, Some(json!([1.5])), 3);
            store.update_job(&done).unwrap();
            let mut open = add(&store, "train", 1);
            store.begin_job(open.number).unwrap();
            store.begin_job(open.number).unwrap();
            store.put_back_job(open.number).unwrap();
            (open.state, open.starts) = (JobState::Waiting, 1);
            store.update_job(&open).unwrap();
            (done, open)
        };
        let store = Store::open(dir.path()).unwrap();
        assert_eq!(store.job(done.number).unwrap().unwrap(), done);
        assert_eq!(store.unfinished().unwrap(), std::slice::from_ref(&open));
        let counts = store.jobs_by_state().unwrap();
        assert_eq!(counts, BTreeMap::from([("succeeded".into(), 1), ("waiting".into(), 1)]));
        assert_eq!(store.jobs(0, 1, None).unwrap(), [done]);
        assert_eq!(store.jobs(1, 9, None).unwrap(), [open]);
    }

    #[test]
    fn numbers_are_not_used_twice() {
        let store = Store::in_memory().unwrap();
        let first = add(&store, "iplw", 0).number;
        assert!(store.remove_job(first).unwrap());
        assert!(!store.remove_job(first).unwrap());
        assert_ne!(add(&store, "iplw", 0).number, first);
    }
}
