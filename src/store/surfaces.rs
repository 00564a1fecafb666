//! Performance surfaces as rows, reused by requests with the same configuration.

use rusqlite::{Row, params};

use super::{Store, sql};
use crate::error::Result;

/// A stored surface.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceRow {
    pub number: i64,
    /// Task family.
    pub task: String,
    /// Configuration, the caller's JSON; unique for the task.
    pub config: String,
    /// The surface, the caller's JSON.
    pub body: String,
    /// Id of the job that computed it.
    pub job: Option<String>,
    /// Version of the program that stored it.
    pub version: String,
}

const COLUMNS: &str = "number, task, config, body, job, version, whole, record";

impl Store {
    /// Stores a surface, replacing one with the same task and configuration; returns its number.
    pub fn put_surface(&self, task: &str, config: &str, body: &str, job: Option<&str>) -> Result<i64> {
        self.connection()
            .query_row(
                "INSERT INTO surface (task, config, body, job, version) VALUES (?1, ?2, ?3, ?4, ?5) \
                 ON CONFLICT (task, config) DO UPDATE SET body = excluded.body, job = excluded.job, \
                 version = excluded.version RETURNING number",
                params![task, config, body, job, env!("CARGO_PKG_VERSION")],
                |r| r.get(0),
            )
            .map_err(sql)
    }

    /// The surface with this number.
    pub fn surface(&self, number: i64) -> Result<Option<SurfaceRow>> {
        let select = format!("SELECT {COLUMNS} FROM whole_surface WHERE number = ?1");
        self.row(&select, [number], row)
    }

    /// The surface of a task and configuration computed by this version of the program.
    pub fn surface_like(&self, task: &str, config: &str) -> Result<Option<SurfaceRow>> {
        let select =
            format!("SELECT {COLUMNS} FROM whole_surface WHERE task = ?1 AND config = ?2 AND version = ?3");
        self.row(&select, params![task, config, env!("CARGO_PKG_VERSION")], row)
    }

    /// At most `limit` surfaces after number `after`, in order.
    pub fn surfaces(&self, after: i64, limit: usize) -> Result<Vec<SurfaceRow>> {
        let select =
            format!("SELECT {COLUMNS} FROM whole_surface WHERE number > ?1 ORDER BY number LIMIT ?2");
        self.rows(&select, params![after, limit as i64], row)
    }

    /// Removes a surface; whether it existed.
    pub fn remove_surface(&self, number: i64) -> Result<bool> {
        self.execute("DELETE FROM surface WHERE number = ?1", [number]).map(|n| n > 0)
    }
}

fn row(row: &Row) -> rusqlite::Result<SurfaceRow> {
    Ok(SurfaceRow {
        number: row.get(0)?,
        task: row.get(1)?,
        config: row.get(2)?,
        body: row.get(3)?,
        job: row.get(4)?,
        version: row.get(5)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_surface_of_same_configuration() {
        let store = Store::in_memory().unwrap();
        let first = store.put_surface("bowling", "a", "1", None).unwrap();
        let second = store.put_surface("bowling", "b", "2", Some("job-1")).unwrap();
        assert_eq!(store.put_surface("bowling", "a", "3", Some("job-2")).unwrap(), first);
        assert_eq!(store.surface(first).unwrap().unwrap().body, "3");
        assert_eq!(store.surface_like("bowling", "b").unwrap().unwrap().number, second);
        assert_eq!(store.surface_like("basketball", "b").unwrap(), None);
        let numbers =
            |after| -> Vec<i64> { store.surfaces(after, 9).unwrap().into_iter().map(|s| s.number).collect() };
        assert_eq!((numbers(0), numbers(first)), (vec![first, second], vec![second]));
        assert!(store.remove_surface(first).unwrap() && !store.remove_surface(first).unwrap());
    }
}
