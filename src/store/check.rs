//! Whether what is stored is what was written: the database's structure, its tables, every row's checksum, and the weights
//! that rows name. A server looks at all of it when it starts, but for the weights' digests, at which it looks when it reads
//! them; `iplw check` looks at those as well.

use std::collections::BTreeMap;
use std::path::Path;

use rusqlite::Connection;
use rusqlite::types::ValueRef;

use super::blobs::Blobs;
use super::place::Place;
use super::sqlite::{failed, sql};
use super::{schema, seal};
use crate::error::{Error, Result};

/// Something that is not as it was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What it is: `world w1`, `weights a.3.safetensors`, or a file.
    pub record: String,
    /// How that shows.
    pub how: String,
}

/// What a data directory holds, and what of it is damaged.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Checked {
    /// Version of its tables.
    pub version: i64,
    /// Rows by table.
    pub rows: BTreeMap<&'static str, u64>,
    pub damaged: Vec<Finding>,
    /// What is no damage and still worth knowing.
    pub notes: Vec<String>,
}

/// How far to look at weights.
#[derive(Clone, Copy, PartialEq)]
pub enum Weights {
    /// They are there, and as long as they should be.
    Size,
    /// Every byte.
    Digest,
}

/// Most findings of SQLite's own that are told.
const MOST_TOLD: usize = 100;

/// Looks at all of a data directory. Changes nothing, and may be done while a server runs on it.
pub fn check(directory: &Path) -> Result<Checked> {
    let found = look(directory)?;
    // A server may have replaced weights between the look at their row and the look at them; damage is there the next time.
    if found.damaged.is_empty() { Ok(found) } else { look(directory) }
}

fn look(directory: &Path) -> Result<Checked> {
    let place = Place::at(directory);
    let mut found = Checked::default();
    let damaged = |e: Error| Finding::of(e).map(|f| vec![f]);
    match place.there() {
        Err(e @ Error::Damaged { .. }) => return damaged(e).map(|damaged| Checked { damaged, ..found }),
        other => other?,
    }
    let name = place.database.display().to_string();
    let mut c = match place.connect() {
        Ok(c) => c,
        Err(e) => return damaged(e).map(|damaged| Checked { damaged, ..found }),
    };
    // One look at what a server may be changing.
    let c = c.transaction().map_err(|e| failed(&name, &e))?;
    found.damaged = structure(&c, &name)?;
    found.version = match schema::version(&c, &name) {
        Ok(version) => version,
        Err(e) if found.damaged.is_empty() => return Err(e),
        Err(_) => return Ok(found),
    };
    let blobs = Blobs::Directory(place.policies);
    if found.version < schema::SEALED {
        let (was, since) = (found.version, schema::SEALED);
        let note = format!(
            "tables of version {was}: rows have checksums from version {since} on, as soon as a server has it open"
        );
        found.notes.push(note);
        found.damaged.extend(shape(&c, found.version)?);
        return Ok(found);
    }
    found.damaged.extend(content(&c, found.version, &blobs, Weights::Digest)?);
    for table in seal::tables(found.version) {
        // A table that cannot be read is among the findings.
        let count =
            c.query_row(&format!("SELECT count(*) FROM main.{}", table.name), [], |r| r.get::<_, i64>(0));
        found.rows.extend(count.ok().map(|n| (table.name, n as u64)));
    }
    found.notes.extend(orphans(&c));
    Ok(found)
}

/// What SQLite finds of the structure of the database: pages, order, indexes, types.
pub fn structure(c: &Connection, name: &str) -> Result<Vec<Finding>> {
    let all = || -> rusqlite::Result<Vec<String>> {
        let mut query = c.prepare(&format!("PRAGMA main.integrity_check({MOST_TOLD})"))?;
        let lines = query.query_map([], |r| {
            Ok(match r.get_ref(0)? {
                ValueRef::Text(said) => String::from_utf8_lossy(said).into_owned(),
                _ => "it cannot be told what is".into(),
            })
        })?;
        lines.collect()
    };
    match all() {
        Ok(said) if said == ["ok"] => Ok(Vec::new()),
        Ok(said) => Ok(said.into_iter().map(|how| Finding { record: name.into(), how }).collect()),
        Err(e) => Ok(vec![Finding::of(failed(name, &e))?]),
    }
}

/// What is not as it was written, in a database whose tables are those of a version with checksums.
pub fn content(c: &Connection, version: i64, blobs: &Blobs, weights: Weights) -> Result<Vec<Finding>> {
    let mut found = shape(c, version)?;
    if found.is_empty() {
        for table in seal::tables(version) {
            found.extend(rows(c, table)?);
        }
        found.extend(references(c, blobs, weights)?);
    }
    Ok(found)
}

/// Whether the tables are those of a version.
pub fn shape(c: &Connection, version: i64) -> Result<Vec<Finding>> {
    let wanted = schema::shape_of(version).map_err(sql)?;
    let how = match schema::shape(c) {
        Ok(shape) if shape == wanted => return Ok(Vec::new()),
        Ok(_) => format!("they are not those of version {version}"),
        Err(e) => e.to_string(),
    };
    Ok(vec![Finding { record: "the tables' description".into(), how }])
}

/// Rows of a table whose checksum is another.
fn rows(c: &Connection, table: &seal::Table) -> Result<Vec<Finding>> {
    let (name, record, seal) = (table.name, table.record(""), table.seal(""));
    let all = || -> rusqlite::Result<Vec<Finding>> {
        let mut query =
            c.prepare(&format!("SELECT {record} AS record FROM main.{name} WHERE seal IS NOT {seal}"))?;
        query.query_map([], |r| Ok(Finding { record: seal::record(r), how: seal::OTHER.into() }))?.collect()
    };
    match all() {
        Ok(found) => Ok(found),
        Err(e) => Ok(vec![Finding::of(failed(&format!("table {name}"), &e))?]),
    }
}

/// Weights that policies name and that are not there as they were written.
fn references(c: &Connection, blobs: &Blobs, weights: Weights) -> Result<Vec<Finding>> {
    type Named = (String, String, String, i64);
    let named = || -> rusqlite::Result<Vec<Named>> {
        let mut query = c.prepare("SELECT id, blob, digest, bytes FROM main.policy ORDER BY number")?;
        query.query_map([], |r| Ok((r.get(0)?, r.get(1)?, r.get(2)?, r.get(3)?)))?.collect()
    };
    // Rows that cannot be read were told of before.
    let Ok(named) = named() else { return Ok(Vec::new()) };
    let mut found = Vec::new();
    for (id, blob, digest, bytes) in named {
        let how = match blobs.length(&blob) {
            None => "the file is gone".to_string(),
            Some(length) if length != bytes as u64 => format!("{length} bytes of {bytes}"),
            Some(_) if weights == Weights::Size => continue,
            Some(_) if blobs.digest(&blob).as_deref() == Some(&digest) => continue,
            Some(_) => "their SHA-256 is another".to_string(),
        };
        found.push(Finding { record: format!("weights of policy {id} ({blob})"), how });
    }
    Ok(found)
}

/// Parts of jobs that are gone do no harm.
fn orphans(c: &Connection) -> Vec<String> {
    let of = |table: &str| {
        let select =
            format!("SELECT count(*) FROM main.{table} WHERE job NOT IN (SELECT number FROM main.job)");
        c.query_row(&select, [], |r| r.get::<_, i64>(0)).unwrap_or(0)
    };
    let parts = ["round", "measured", "artifact", "log"];
    let counted = parts.map(|table| (table, of(table)));
    let told = counted.iter().filter(|(_, n)| *n > 0);
    told.map(|(table, n)| format!("{n} rows of table {table} belong to jobs that are gone; they do no harm"))
        .collect()
}

/// The error of a store that cannot be opened for what was found.
pub fn refuse(found: &[Finding]) -> Result<()> {
    let Some(first) = found.first() else { return Ok(()) };
    let more = if found.len() > 1 { format!(" and {} more", found.len() - 1) } else { String::new() };
    Err(Error::Damaged { what: format!("{}{more}", first.record), how: first.how.clone() })
}

impl Finding {
    /// What an error says, if it says that something is damaged; else the error.
    pub fn of(error: Error) -> Result<Finding> {
        match error {
            Error::Damaged { what, how } => Ok(Finding { record: what, how }),
            // A statement that SQLite cannot make sense of, though it is ours: the description of the tables is another.
            Error::Io { path, message } => Ok(Finding { record: path, how: message }),
            other => Err(other),
        }
    }
}
