//! What happened to a job, line by line: kept for as long as the job, the latest lines where there are many.
//!
//! A line is written with the next [`Store::flush_log`], within a second on a server; whoever reads sees it at once.

use std::sync::PoisonError;
use std::time::{SystemTime, UNIX_EPOCH};

use rusqlite::{Row, Transaction, params};

use super::noted::{Level, Noted};
use super::{Store, seal, sql};
use crate::error::Result;

/// Lines kept of a job; of more the oldest go.
pub const KEPT_LINES: u64 = 1000;
/// Longest text of a line, bytes; a longer one is cut.
const MOST_TEXT: usize = 1000;

/// One line as stored.
#[derive(Clone, Debug, PartialEq)]
pub struct LogRow {
    /// From 1, in the order of happening.
    pub number: u64,
    /// ms since 1970
    pub at: u64,
    pub level: Level,
    pub text: String,
}

impl Store {
    /// Remembers a line for the next flush.
    pub fn note_line(&self, job: i64, level: Level, text: &str) {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let noted = Noted { job, at: since.as_millis() as u64, level, text: shown(text) };
        self.lines.lock().unwrap_or_else(PoisonError::into_inner).push(noted);
    }

    /// Writes the lines that were remembered; those of jobs that are gone go, too.
    pub fn flush_log(&self) -> Result<()> {
        // Held until they are written, so that those noted later come later.
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        if lines.is_empty() {
            return Ok(());
        }
        self.atomically(|t| lines.iter().try_for_each(|line| write(t, line)))?;
        lines.clear();
        Ok(())
    }

    /// At most `limit` lines of a job, those after number `after`.
    pub fn log(&self, job: i64, after: u64, limit: usize) -> Result<Vec<LogRow>> {
        self.flush_log()?;
        let c = self.connection();
        let select = "SELECT number, at, level, text, whole, record FROM whole_log WHERE job = ?1 AND number > ?2 \
                      ORDER BY number LIMIT ?3";
        let mut query = c.prepare(select).map_err(sql)?;
        let rows = query.query_map(params![job, after as i64, limit as i64], row).map_err(sql)?;
        rows.collect::<rusqlite::Result<_>>().map_err(sql)
    }
}

fn write(t: &Transaction, line: &Noted) -> rusqlite::Result<()> {
    t.prepare_cached(
        "INSERT INTO log (job, number, at, level, text) \
         SELECT ?1, (SELECT coalesce(max(number), 0) + 1 FROM log WHERE job = ?1), ?2, ?3, ?4 \
         WHERE EXISTS (SELECT 1 FROM job WHERE number = ?1)",
    )?
    .execute(params![line.job, line.at as i64, line.level.name(), line.text])?;
    t.prepare_cached(
        "DELETE FROM log WHERE job = ?1 AND number <= (SELECT max(number) FROM log WHERE job = ?1) - ?2",
    )?
    .execute(params![line.job, KEPT_LINES as i64])
    .map(drop)
}

fn row(row: &Row) -> rusqlite::Result<LogRow> {
    seal::whole(row)?;
    let level: String = row.get(2)?;
    let level =
        Level::named(&level).ok_or_else(|| seal::unreadable(row, &format!("there is no level {level:?}")))?;
    Ok(LogRow {
        number: row.get::<_, i64>(0)? as u64,
        at: row.get::<_, i64>(1)? as u64,
        level,
        text: row.get(3)?,
    })
}

/// One line, not longer than a line may be.
fn shown(text: &str) -> String {
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    match line.char_indices().map(|(i, c)| i + c.len_utf8()).take_while(|end| *end <= MOST_TEXT).last() {
        Some(end) if end < line.len() => format!("{} ...", &line[..end]),
        _ => line,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn job(store: &Store) -> i64 {
        store.add_job("act", &json!({}), &json!({}), 0, None, &|_| None).unwrap().number
    }

    #[test]
    fn lines_are_read_in_order_and_survive() {
        let dir = tempfile::tempdir().unwrap();
        let (one, other);
        {
            let store = Store::open(dir.path()).unwrap();
            (one, other) = (job(&store), job(&store));
            store.note_line(one, Level::Info, "begun");
            store.note_line(other, Level::Error, "no\nway");
            store.note_line(one, Level::Warning, "slow");
            store.note_line(99, Level::Info, "of nobody");
            let lines = store.log(one, 0, 9).unwrap();
            let told: Vec<_> = lines.iter().map(|l| (l.number, l.level, l.text.as_str())).collect();
            assert_eq!(told, [(1, Level::Info, "begun"), (2, Level::Warning, "slow")]);
            assert!(lines[0].at > 1_600_000_000_000 && lines[1].at >= lines[0].at);
            store.note_line(one, Level::Info, "done");
            store.flush_log().unwrap();
        }
        let store = Store::open(dir.path()).unwrap();
        assert_eq!(store.log(one, 2, 9).unwrap()[0].text, "done");
        assert_eq!(store.log(one, 0, 2).unwrap().len(), 2);
        assert_eq!(store.log(other, 0, 9).unwrap()[0].text, "no way");
        assert!(store.log(99, 0, 9).unwrap().is_empty());
        store.remove_job(one).unwrap();
        assert!(store.log(one, 0, 9).unwrap().is_empty());
    }

    #[test]
    fn of_many_lines_the_latest_are_kept_and_long_ones_are_cut() {
        let store = Store::in_memory().unwrap();
        let job = job(&store);
        (0..KEPT_LINES + 5).for_each(|i| store.note_line(job, Level::Info, &i.to_string()));
        let lines = store.log(job, 0, usize::MAX >> 1).unwrap();
        assert_eq!((lines.len() as u64, lines[0].number, lines[0].text.as_str()), (KEPT_LINES, 6, "5"));
        store.note_line(job, Level::Info, &"ä".repeat(MOST_TEXT));
        let cut = store.log(job, KEPT_LINES + 5, 9).unwrap().remove(0).text;
        assert!(cut.len() <= MOST_TEXT + 4 && cut.ends_with("ä ..."), "{cut}");
    }

    #[test]
    fn a_line_that_is_damaged_is_named() {
        let store = Store::in_memory().unwrap();
        let job = job(&store);
        store.note_line(job, Level::Info, "begun");
        store.flush_log().unwrap();
        let triggers = ["made", "looked_at", "changed"].map(|t| format!("DROP TRIGGER temp.log_{t};"));
        store.connection().execute_batch(&triggers.concat()).unwrap();
        store.connection().execute("UPDATE log SET text = 'x'", []).unwrap();
        let told = store.log(job, 0, 9).unwrap_err().to_string();
        assert!(told.contains("line 1 of the log of job-1"), "{told}");
    }
}
