//! Rounds of a job: proposed trials, measured outcomes, and the round's result.

use std::collections::BTreeMap;

use rusqlite::{Row, Transaction, params};

use super::Store;
use super::requests::{StoredResponse, keep};
use super::worlds::raise;
use crate::error::Result;

/// A stored round; both texts are the caller's JSON.
#[derive(Clone, Debug, PartialEq)]
pub struct RoundRow {
    pub number: u64,
    /// Proposed trials.
    pub asked: String,
    /// Result; `None` while the round is open.
    pub done: Option<String>,
}

/// Measured outcomes of a job, by number: the caller's JSON, or `None` for an infeasible trial.
pub type MeasuredOutcomes = BTreeMap<u64, Option<String>>;

impl Store {
    /// A job's rounds in order.
    pub fn rounds(&self, job: i64) -> Result<Vec<RoundRow>> {
        let select = format!("SELECT {COLUMNS} FROM whole_round WHERE job = ?1 ORDER BY number");
        self.rows(&select, [job], row)
    }

    /// A job's last round.
    pub fn last_round(&self, job: i64) -> Result<Option<RoundRow>> {
        let select = format!("SELECT {COLUMNS} FROM whole_round WHERE job = ?1 ORDER BY number DESC LIMIT 1");
        self.row(&select, [job], row)
    }

    /// Opens a round.
    pub fn open_round(&self, job: i64, number: u64, asked: &str) -> Result<()> {
        self.atomically(|t| {
            t.execute(
                "INSERT INTO round (job, number, asked) VALUES (?1, ?2, ?3)",
                params![job, number as i64, asked],
            )?;
            progress(t, job)
        })
    }

    /// Closes a round.
    pub fn close_round(&self, job: i64, number: u64, done: &str) -> Result<()> {
        self.atomically(|t| {
            t.execute(
                "UPDATE round SET done = ?3 WHERE job = ?1 AND number = ?2",
                params![job, number as i64, done],
            )?;
            progress(t, job)
        })
    }

    /// Measured outcomes of a job, from number `first` on.
    pub fn measured(&self, job: i64, first: u64) -> Result<MeasuredOutcomes> {
        let select =
            "SELECT number, outcome, whole, record FROM whole_measured WHERE job = ?1 AND number >= ?2";
        let row = |r: &Row| Ok((r.get::<_, i64>(0)? as u64, r.get(1)?));
        Ok(self.rows(select, params![job, first as i64], row)?.into_iter().collect())
    }

    /// Stores outcomes, replacing existing ones; in the same transaction the interaction count of their world, and the response to
    /// the request that submitted them.
    pub fn put_measured(
        &self,
        job: i64,
        measured: &MeasuredOutcomes,
        world: Option<(&str, u64)>,
        answered: Option<&StoredResponse>,
    ) -> Result<()> {
        self.atomically(|t| {
            let mut insert =
                t.prepare("INSERT OR REPLACE INTO measured (job, number, outcome) VALUES (?1, ?2, ?3)")?;
            for (number, outcome) in measured {
                insert.execute(params![job, *number as i64, outcome])?;
            }
            if let Some((id, interactions)) = world {
                raise(t, id, interactions)?;
            }
            progress(t, job)?;
            keep(t, answered)
        })
    }
}

const COLUMNS: &str = "number, asked, done, whole, record";

fn row(r: &Row) -> rusqlite::Result<RoundRow> {
    Ok(RoundRow { number: r.get::<_, i64>(0)? as u64, asked: r.get(1)?, done: r.get(2)? })
}

/// Records progress of a job.
fn progress(t: &Transaction, job: i64) -> rusqlite::Result<()> {
    t.execute("UPDATE job SET starts = min(starts, 1) WHERE number = ?1", [job]).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn rounds_survive_and_count_as_progress() {
        let dir = tempfile::tempdir().unwrap();
        let job = {
            let store = Store::open(dir.path()).unwrap();
            store.add_world("w", "{}", None, None).unwrap();
            let job = store.add_job("iplw", &json!({}), &json!({}), 0, None, &|_| None).unwrap();
            (0..4).for_each(|_| store.begin_job(job.number, 5).unwrap());
            store.open_round(job.number, 0, "[0, 1]").unwrap();
            let some = MeasuredOutcomes::from([(0, Some("a".into())), (1, None)]);
            store.put_measured(job.number, &some, Some(("w", 7)), None).unwrap();
            store.close_round(job.number, 0, "done").unwrap();
            store.open_round(job.number, 1, "[2]").unwrap();
            let more = MeasuredOutcomes::from([(1, Some("b".into())), (2, None)]);
            store.put_measured(job.number, &more, Some(("w", 5)), None).unwrap();
            job.number
        };
        let store = Store::open(dir.path()).unwrap();
        assert_eq!(store.job(job).unwrap().unwrap().starts, 1);
        let rounds = store.rounds(job).unwrap();
        assert_eq!(rounds[0], RoundRow { number: 0, asked: "[0, 1]".into(), done: Some("done".into()) });
        assert_eq!(rounds[1], RoundRow { number: 1, asked: "[2]".into(), done: None });
        assert_eq!(
            store.measured(job, 0).unwrap(),
            MeasuredOutcomes::from([(0, Some("a".into())), (1, Some("b".into())), (2, None)])
        );
        assert_eq!(store.measured(job, 2).unwrap(), MeasuredOutcomes::from([(2, None)]));
        assert_eq!(store.worlds().unwrap()[0].interactions, 7, "a counter never goes back");
        store.remove_job(job).unwrap();
        assert!(store.rounds(job).unwrap().is_empty() && store.measured(job, 0).unwrap().is_empty());
    }
}
