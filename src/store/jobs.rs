//! Jobs as rows.

use rusqlite::{OptionalExtension, Row, params};
use serde_json::Value;

use super::{Store, json, sql};
use crate::error::Result;

/// One job as stored.
#[derive(Clone, Debug, PartialEq)]
pub struct JobRow {
    /// Never used twice, restarts included.
    pub number: i64,
    pub kind: String,
    pub state: JobState,
    /// What was asked for, complete: enough to start it again.
    pub config: Value,
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
}

/// Where a job stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JobState {
    Queued,
    Running,
    Succeeded,
    Failed,
    Cancelled,
}

impl Store {
    /// Takes in a queued job and numbers it.
    pub fn add_job(&self, kind: &str, config: &Value, seed: u64) -> Result<JobRow> {
        let version = env!("CARGO_PKG_VERSION");
        let c = self.connection();
        c.execute(
            "INSERT INTO job (kind, state, config, seed, version) VALUES (?1, 'queued', ?2, ?3, ?4)",
            params![kind, config.to_string(), seed.to_string(), version],
        )
        .map_err(sql)?;
        Ok(JobRow {
            number: c.last_insert_rowid(),
            kind: kind.into(),
            state: JobState::Queued,
            config: config.clone(),
            result: None,
            error: None,
            seed,
            version: version.into(),
            stage: String::new(),
            done: 0,
            total: 0,
            events: 0,
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

    /// The job with this number.
    pub fn job(&self, number: i64) -> Result<Option<JobRow>> {
        self.connection()
            .query_row(&format!("SELECT {COLUMNS} FROM job WHERE number = ?1"), [number], row)
            .optional()
            .map_err(sql)
    }

    /// All jobs in order of number.
    pub fn jobs(&self) -> Result<Vec<JobRow>> {
        let c = self.connection();
        let mut query = c.prepare(&format!("SELECT {COLUMNS} FROM job ORDER BY number")).map_err(sql)?;
        let rows = query.query_map([], row).map_err(sql)?;
        rows.collect::<rusqlite::Result<_>>().map_err(sql)
    }

    /// Forgets a job; whether there was one.
    pub fn remove_job(&self, number: i64) -> Result<bool> {
        self.connection().execute("DELETE FROM job WHERE number = ?1", [number]).map(|n| n > 0).map_err(sql)
    }

    /// Fails every job that has not ended, for a server that starts after one that stopped; returns how many.
    pub fn fail_unfinished(&self, error: &Value) -> Result<usize> {
        self.connection()
            .execute(
                "UPDATE job SET state = 'failed', error = ?1, events = events + 1 \
                 WHERE state IN ('queued', 'running')",
                [error.to_string()],
            )
            .map_err(sql)
    }
}

const COLUMNS: &str = "number, kind, state, config, result, error, seed, version, stage, done, total, events";

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
    })
}

impl JobState {
    /// Every state.
    pub const ALL: [JobState; 5] =
        [JobState::Queued, JobState::Running, JobState::Succeeded, JobState::Failed, JobState::Cancelled];

    /// The name used in files and on the wire.
    pub fn name(self) -> &'static str {
        match self {
            JobState::Queued => "queued",
            JobState::Running => "running",
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

    #[test]
    fn an_ended_job_survives_and_an_unfinished_one_fails() {
        let dir = tempfile::tempdir().unwrap();
        let (done, open) = {
            let store = Store::open(dir.path()).unwrap();
            let mut done = store.add_job("iplw", &json!({"a": 1}), u64::MAX).unwrap();
            (done.state, done.result, done.events) = (JobState::Succeeded, Some(json!([1.5])), 3);
            store.update_job(&done).unwrap();
            (done, store.add_job("train", &json!({}), 1).unwrap())
        };
        let store = Store::open(dir.path()).unwrap();
        assert_eq!(store.fail_unfinished(&json!({"detail": "stopped"})).unwrap(), 1);
        assert_eq!(store.job(done.number).unwrap().unwrap(), done);
        let open = store.job(open.number).unwrap().unwrap();
        assert_eq!((open.state, open.error), (JobState::Failed, Some(json!({"detail": "stopped"}))));
    }

    #[test]
    fn numbers_are_not_used_twice() {
        let store = Store::in_memory().unwrap();
        let first = store.add_job("iplw", &json!({}), 0).unwrap().number;
        assert!(store.remove_job(first).unwrap());
        assert!(!store.remove_job(first).unwrap());
        assert_ne!(store.add_job("iplw", &json!({}), 0).unwrap().number, first);
    }
}
