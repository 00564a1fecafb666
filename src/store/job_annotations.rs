//! Names and notes that owners give to jobs, and jobs by the time of their end.

use rusqlite::params;

use super::{Store, query, sql};
use crate::error::Result;

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
    use crate::store::JobMetadata;

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
