//! Logs of jobs, kept as long as the job; only the latest lines of long logs.
//!
//! Lines are written by the next [`Store::flush_log`], on a server within a second; readers see them at once.

use rusqlite::{Row, Transaction, params};

use super::clock::unix_ms;
use super::log_line::{LogLevel, PendingLogLine};
use super::{Store, checksum};
use crate::error::Result;
use crate::sync::lock;

/// Maximum lines kept of a job; the oldest are removed.
pub const MAX_LOG_LINES_PER_JOB: u64 = 1000;
/// Maximum length of a line, bytes; longer ones are truncated.
const MAX_LOG_TEXT_BYTES: usize = 1000;

/// A stored line.
#[derive(Clone, Debug, PartialEq)]
pub struct LogRow {
    /// From 1, in order.
    pub number: u64,
    /// ms since 1970
    pub at: u64,
    pub level: LogLevel,
    pub text: String,
}

impl Store {
    /// Buffers a line for the next flush.
    pub fn note_line(&self, job: i64, level: LogLevel, text: &str) {
        let noted = PendingLogLine { job, at: unix_ms(), level, text: single_line(text) };
        lock(&self.lines).push(noted);
    }

    /// Writes the buffered lines; lines of removed jobs are dropped.
    pub fn flush_log(&self) -> Result<()> {
        // Locked until they are written, so that the order is kept.
        let mut lines = lock(&self.lines);
        if lines.is_empty() {
            return Ok(());
        }
        self.atomically(|t| lines.iter().try_for_each(|line| write(t, line)))?;
        lines.clear();
        Ok(())
    }

    /// At most `limit` lines of a job after number `after`.
    pub fn log(&self, job: i64, after: u64, limit: usize) -> Result<Vec<LogRow>> {
        self.flush_log()?;
        let select = "SELECT number, at, level, text, whole, record FROM whole_log WHERE job = ?1 AND number > ?2 \
                      ORDER BY number LIMIT ?3";
        self.rows(select, params![job, after as i64, limit as i64], row)
    }
}

fn write(t: &Transaction, line: &PendingLogLine) -> rusqlite::Result<()> {
    t.prepare_cached(
        "INSERT INTO log (job, number, at, level, text) \
         SELECT ?1, (SELECT coalesce(max(number), 0) + 1 FROM log WHERE job = ?1), ?2, ?3, ?4 \
         WHERE EXISTS (SELECT 1 FROM job WHERE number = ?1)",
    )?
    .execute(params![line.job, line.at as i64, line.level.name(), line.text])?;
    t.prepare_cached(
        "DELETE FROM log WHERE job = ?1 AND number <= (SELECT max(number) FROM log WHERE job = ?1) - ?2",
    )?
    .execute(params![line.job, MAX_LOG_LINES_PER_JOB as i64])
    .map(drop)
}

fn row(row: &Row) -> rusqlite::Result<LogRow> {
    let level: String = row.get(2)?;
    let level = LogLevel::named(&level)
        .ok_or_else(|| checksum::unreadable(row, &format!("there is no level {level:?}")))?;
    Ok(LogRow {
        number: row.get::<_, i64>(0)? as u64,
        at: row.get::<_, i64>(1)? as u64,
        level,
        text: row.get(3)?,
    })
}

/// The text as one line of limited length.
fn single_line(text: &str) -> String {
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    match line
        .char_indices()
        .map(|(i, c)| i + c.len_utf8())
        .take_while(|end| *end <= MAX_LOG_TEXT_BYTES)
        .last()
    {
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
    fn log_lines_are_ordered_and_survive() {
        let dir = tempfile::tempdir().unwrap();
        let (one, other);
        {
            let store = Store::open(dir.path()).unwrap();
            (one, other) = (job(&store), job(&store));
            store.note_line(one, LogLevel::Info, "begun");
            store.note_line(other, LogLevel::Error, "no\nway");
            store.note_line(one, LogLevel::Warning, "slow");
            store.note_line(99, LogLevel::Info, "without a job");
            let lines = store.log(one, 0, 9).unwrap();
            let texts: Vec<_> = lines.iter().map(|l| (l.number, l.level, l.text.as_str())).collect();
            assert_eq!(texts, [(1, LogLevel::Info, "begun"), (2, LogLevel::Warning, "slow")]);
            assert!(lines[0].at > 1_600_000_000_000 && lines[1].at >= lines[0].at);
            store.note_line(one, LogLevel::Info, "done");
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
    fn keeps_latest_lines_and_truncates_long_ones() {
        let store = Store::in_memory().unwrap();
        let job = job(&store);
        (0..MAX_LOG_LINES_PER_JOB + 5).for_each(|i| store.note_line(job, LogLevel::Info, &i.to_string()));
        let lines = store.log(job, 0, usize::MAX >> 1).unwrap();
        assert_eq!(
            (lines.len() as u64, lines[0].number, lines[0].text.as_str()),
            (MAX_LOG_LINES_PER_JOB, 6, "5")
        );
        store.note_line(job, LogLevel::Info, &"ä".repeat(MAX_LOG_TEXT_BYTES));
        let cut = store.log(job, MAX_LOG_LINES_PER_JOB + 5, 9).unwrap().remove(0).text;
        assert!(cut.len() <= MAX_LOG_TEXT_BYTES + 4 && cut.ends_with("ä ..."), "{cut}");
    }

    #[test]
    fn damaged_log_line_is_named() {
        let store = Store::in_memory().unwrap();
        let job = job(&store);
        store.note_line(job, LogLevel::Info, "begun");
        store.flush_log().unwrap();
        let triggers = ["made", "looked_at", "changed"].map(|t| format!("DROP TRIGGER temp.log_{t};"));
        store.connection().execute_batch(&triggers.concat()).unwrap();
        store.connection().execute("UPDATE log SET text = 'x'", []).unwrap();
        let texts = store.log(job, 0, 9).unwrap_err().to_string();
        assert!(texts.contains("line 1 of the log of job-1"), "{texts}");
    }
}
