//! Metadata of jobs that an earlier version made.

use rusqlite::Connection;

use super::checksum;

/// Adds metadata to the jobs of a version without them: the times that its job log (ms) and its column `ended` (s) hold.
pub fn add_missing(c: &Connection) -> rusqlite::Result<()> {
    let first = |text: &str| {
        format!("(SELECT min(log.at) FROM log WHERE log.job = job.number AND log.text = '{text}')")
    };
    let (created, started) = (first("queued"), first("started"));
    let table = checksum::TABLES.iter().find(|t| t.name == "metadata");
    let seal = table.map(|t| t.seal("")).unwrap_or_default();
    c.execute_batch(&format!(
        "INSERT INTO metadata (job, created, started, ended)
             SELECT number, {created}, {started}, max(1000 * ended, coalesce({started}, 0)) FROM job
             WHERE number NOT IN (SELECT job FROM metadata);
         UPDATE metadata SET seal = {seal} WHERE seal IS NULL;"
    ))
}
