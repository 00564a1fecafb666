//! Names, notes and times of jobs: a table of its own, so that a change of a name does not compute the checksum of a large result
//! again.

use rusqlite::{Row, Transaction, params};

use super::{Store, query, sql};
use crate::error::Result;

/// Name, note, times and summary of a job.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JobMetadata {
    /// Text of its owner; empty if there is none.
    pub name: String,
    /// Text of its owner; empty if there is none.
    pub note: String,
    /// ms since 1970; unknown for some jobs of earlier versions.
    pub created: Option<u64>,
    /// Time of its first start, ms since 1970.
    pub started: Option<u64>,
    /// ms since 1970.
    pub ended: Option<u64>,
    /// The result in a phrase.
    pub summary: Option<String>,
}

/// Columns of `whole_metadata` that [`from_columns`] reads.
pub const COLUMNS: &str = "name, note, created, started, metadata_ended, summary";

/// The metadata in a row that has these columns from column `first` on.
pub fn from_columns(row: &Row, first: usize) -> rusqlite::Result<JobMetadata> {
    let text = |i: usize| row.get::<_, Option<String>>(first + i);
    let time = |i: usize| Ok::<_, rusqlite::Error>(row.get::<_, Option<i64>>(first + i)?.map(|t| t as u64));
    Ok(JobMetadata {
        name: text(0)?.unwrap_or_default(),
        note: text(1)?.unwrap_or_default(),
        created: time(2)?,
        started: time(3)?,
        ended: time(4)?,
        summary: text(5)?,
    })
}

/// Adds the metadata of a new job.
pub fn insert(t: &Transaction, job: i64, metadata: &JobMetadata) -> rusqlite::Result<()> {
    let insert = "INSERT INTO metadata (job, name, note, created) VALUES (?1, ?2, ?3, ?4)";
    let created = metadata.created.map(|at| at as i64);
    t.execute(insert, params![job, metadata.name, metadata.note, created]).map(drop)
}

/// Stores the times and the summary. The name and the note change by [`Store::annotate_job`] alone.
pub fn update(t: &Transaction, job: i64, metadata: &JobMetadata) -> rusqlite::Result<()> {
    let ms = |time: Option<u64>| time.map(|at| at as i64);
    t.execute(
        "UPDATE metadata SET started = ?2, ended = ?3, summary = ?4 WHERE job = ?1",
        params![job, ms(metadata.started), ms(metadata.ended), metadata.summary],
    )
    .map(drop)
}

impl Store {
    /// Sets the name and the note of a job, each if there is a value; whether the job exists.
    pub fn annotate_job(&self, number: i64, name: Option<&str>, note: Option<&str>) -> Result<bool> {
        let update =
            "UPDATE metadata SET name = coalesce(?2, name), note = coalesce(?3, note) WHERE job = ?1";
        self.execute(update, params![number, name, note]).map(|changed| changed > 0)
    }

    /// Numbers of the jobs that ended before a moment, s since 1970.
    pub fn ended_before(&self, moment: u64) -> Result<Vec<i64>> {
        let select = "SELECT job FROM metadata WHERE ended < ?1 ORDER BY job";
        let moment = moment.saturating_mul(1000).min(i64::MAX as u64) as i64;
        query(&self.connection(), select, [moment], |r| r.get(0)).map_err(sql)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn annotations_survive_other_updates_and_restarts() {
        let dir = tempfile::tempdir().unwrap();
        let expected = {
            let store = Store::open(dir.path()).unwrap();
            let mut job = store.add_job("iplw", &json!({}), &json!({}), 0, None, &|_| None).unwrap();
            assert!(store.annotate_job(job.number, Some("first"), None).unwrap());
            assert!(store.annotate_job(job.number, None, Some("a\nnote")).unwrap());
            assert!(store.annotate_job(job.number, None, None).unwrap());
            assert!(!store.annotate_job(job.number + 1, Some("x"), None).unwrap());
            let created = job.metadata.created.unwrap();
            (job.metadata.started, job.metadata.ended) = (Some(created + 1), Some(created + 2));
            job.metadata.summary = Some("friction 0.52".into());
            store.update_job(&job).unwrap();
            JobMetadata { name: "first".into(), note: "a\nnote".into(), ..job.metadata }
        };
        let store = Store::open(dir.path()).unwrap();
        assert_eq!(store.job(1).unwrap().unwrap().metadata, expected);
        assert!(store.remove_job(1).unwrap());
        assert!(!store.annotate_job(1, Some("gone"), None).unwrap());
    }
}
