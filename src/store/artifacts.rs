//! Artifacts of jobs: named bytes besides the result.

use rusqlite::params;

use super::Store;
use crate::error::Result;

impl Store {
    /// Stores `body` as the job's artifact `name`, replacing an existing one.
    pub fn put_artifact(&self, job: i64, name: &str, body: &[u8]) -> Result<()> {
        let insert = "INSERT OR REPLACE INTO artifact (job, name, body) VALUES (?1, ?2, ?3)";
        self.execute(insert, params![job, name, body]).map(drop)
    }

    /// The job's artifact `name`.
    pub fn artifact(&self, job: i64, name: &str) -> Result<Option<Vec<u8>>> {
        let select = "SELECT body, whole, record FROM whole_artifact WHERE job = ?1 AND name = ?2";
        self.row(select, params![job, name], |r| r.get(0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn artifacts_are_removed_with_their_job() {
        let store = Store::in_memory().unwrap();
        store.put_artifact(1, "surface", b"old").unwrap();
        store.put_artifact(1, "surface", b"new").unwrap();
        store.put_artifact(2, "surface", b"other").unwrap();
        assert_eq!(store.artifact(1, "surface").unwrap().unwrap(), b"new");
        store.remove_job(1).unwrap();
        assert_eq!(store.artifact(1, "surface").unwrap(), None);
        assert_eq!(store.artifact(2, "surface").unwrap().unwrap(), b"other");
    }
}
