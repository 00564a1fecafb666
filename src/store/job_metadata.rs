//! Names, notes and times of jobs: a table of its own, so that a change of a name does not compute the checksum of a large
//! result again.

use rusqlite::{Connection, Row, Transaction, params};

use super::checksum;

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

/// Adds metadata to the jobs of a version without them: the times that its job log and its column `ended` hold.
pub fn add_missing(c: &Connection) -> rusqlite::Result<()> {
    let first = |text: &str| {
        format!("(SELECT min(log.at) FROM log WHERE log.job = job.number AND log.text = '{text}')")
    };
    let table = checksum::TABLES.iter().find(|t| t.name == "metadata");
    let seal = table.map(|t| t.seal("")).unwrap_or_default();
    c.execute_batch(&format!(
        "INSERT INTO metadata (job, created, started, ended)
             SELECT number, {}, {}, 1000 * ended FROM job WHERE number NOT IN (SELECT job FROM metadata);
         UPDATE metadata SET seal = {seal} WHERE seal IS NULL;",
        first("queued"),
        first("started"),
    ))
}
