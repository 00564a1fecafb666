//! Integrity check: the database's structure, its schema, every row's checksum, and the weights. A server checks all of it at
//! startup except the digests of weights, which it checks when it reads them; `iplw check` checks those as well.

use std::collections::BTreeMap;
use std::path::Path;

use rusqlite::types::ValueRef;
use rusqlite::{Connection, Row};

use super::blobs::Blobs;
use super::data_directory::DataDirectory;
use super::read_access::open_to_read;
use super::sqlite::{failed, query, sql};
use super::{checksum, schema};
use crate::error::{Error, Result};

/// A damaged record.
#[derive(Clone, Debug, PartialEq)]
pub struct DamagedRecord {
    /// Its name: `world w1`, `weights a.3.safetensors`, or a file.
    pub record: String,
    /// How it is damaged.
    pub how: String,
}

/// Result of a check.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckReport {
    /// Version of the schema.
    pub version: i64,
    /// Rows by table.
    pub rows: BTreeMap<&'static str, u64>,
    /// Whether a record belongs to a token.
    pub has_owners: bool,
    pub damaged: Vec<DamagedRecord>,
    /// Observations that are not damage.
    pub notes: Vec<String>,
}

/// How to check weights.
#[derive(Clone, Copy, PartialEq)]
pub enum WeightsCheck {
    /// Existence and size.
    Size,
    /// SHA-256.
    Digest,
}

/// Maximum messages of SQLite's integrity check.
const MAX_INTEGRITY_MESSAGES: usize = 100;

/// Checks a data directory. Read-only; a server may be running on it.
pub fn check(directory: &Path) -> Result<CheckReport> {
    let found = check_once(directory)?;
    // A server may have replaced weights after their row was read; real damage is found again.
    if found.damaged.is_empty() { Ok(found) } else { check_once(directory) }
}

fn check_once(directory: &Path) -> Result<CheckReport> {
    let place = DataDirectory::at(directory);
    let mut found = CheckReport::default();
    let damaged = |e: Error| DamagedRecord::of(e).map(|f| vec![f]);
    match place.check_exists() {
        Err(e @ Error::Damaged { .. }) => return damaged(e).map(|damaged| CheckReport { damaged, ..found }),
        other => other?,
    }
    let name = place.database.display().to_string();
    let mut reader = match open_to_read(&place) {
        Err(e @ Error::Refused { .. }) => return Err(e),
        Err(e) => return damaged(e).map(|damaged| CheckReport { damaged, ..found }),
        Ok(reader) => reader,
    };
    // One transaction, since a server may be writing.
    let c = reader.connection.transaction().map_err(|e| failed(&name, &e))?;
    found.damaged = structure(&c, &name)?;
    found.version = match schema::version(&c, &name) {
        Ok(version) => version,
        Err(e) if found.damaged.is_empty() => return Err(e),
        Err(_) => return Ok(found),
    };
    // Unreadable tables are among the findings.
    found.has_owners = has_owners(&c, found.version).unwrap_or(false);
    let blobs = Blobs::Directory(place.policies);
    if found.version < schema::FIRST_CHECKSUM_VERSION {
        let (was, since) = (found.version, schema::FIRST_CHECKSUM_VERSION);
        let note = format!(
            "schema version {was}: rows have checksums from version {since} on; a server migrates when it opens the directory"
        );
        found.notes.push(note);
        found.damaged.extend(shape(&c, found.version)?);
        return Ok(found);
    }
    found.damaged.extend(content(&c, found.version, &blobs, WeightsCheck::Digest)?);
    for table in checksum::tables(found.version) {
        // A table that cannot be read is among the findings.
        let count =
            c.query_row(&format!("SELECT count(*) FROM main.{}", table.name), [], |r| r.get::<_, i64>(0));
        found.rows.extend(count.ok().map(|n| (table.name, n as u64)));
    }
    found.notes.extend(orphans(&c));
    Ok(found)
}

/// Whether records of a data directory belong to tokens; not if there is no database.
pub fn has_owned_records(directory: &Path) -> Result<bool> {
    let place = DataDirectory::at(directory);
    if !place.database.exists() {
        return Ok(false);
    }
    place.check_exists()?;
    let name = place.database.display().to_string();
    let reader = open_to_read(&place)?;
    let version = schema::version(&reader.connection, &name)?;
    has_owners(&reader.connection, version).map_err(|e| failed(&name, &e))
}

/// Owner of what a local agent makes without a token (`iplw mcp`); no token has this name.
pub const LOCAL_AGENT: &str = "agent";

fn has_owners(c: &Connection, version: i64) -> rusqlite::Result<bool> {
    if version < schema::FIRST_OWNER_VERSION {
        return Ok(false);
    }
    // NULL is not unequal.
    let owned = |table: &str| format!("EXISTS (SELECT 1 FROM main.{table} WHERE owner <> ?1)");
    let select = format!("SELECT {}", ["job", "policy", "world"].map(owned).join(" OR "));
    c.query_row(&select, [LOCAL_AGENT], |r| r.get(0))
}

/// SQLite's own integrity check: pages, order, indexes, types.
pub fn structure(c: &Connection, name: &str) -> Result<Vec<DamagedRecord>> {
    let pragma = format!("PRAGMA main.integrity_check({MAX_INTEGRITY_MESSAGES})");
    let messages = query(c, &pragma, [], |r| {
        Ok(match r.get_ref(0)? {
            ValueRef::Text(messages) => String::from_utf8_lossy(messages).into_owned(),
            _ => "unreadable message".into(),
        })
    });
    match messages {
        Ok(messages) if messages == ["ok"] => Ok(Vec::new()),
        Ok(messages) => {
            Ok(messages.into_iter().map(|how| DamagedRecord { record: name.into(), how }).collect())
        }
        Err(e) => Ok(vec![DamagedRecord::of(failed(name, &e))?]),
    }
}

/// Checks the contents of a database with checksums.
pub fn content(
    c: &Connection,
    version: i64,
    blobs: &Blobs,
    weights: WeightsCheck,
) -> Result<Vec<DamagedRecord>> {
    let mut found = shape(c, version)?;
    if found.is_empty() {
        for table in checksum::tables(version) {
            found.extend(rows(c, table)?);
        }
        found.extend(references(c, blobs, weights)?);
    }
    Ok(found)
}

/// Checks that the schema is that of a version.
pub fn shape(c: &Connection, version: i64) -> Result<Vec<DamagedRecord>> {
    let expected = schema::shape_of(version).map_err(sql)?;
    let how = match schema::shape(c) {
        Ok(shape) if shape == expected => return Ok(Vec::new()),
        Ok(_) => format!("the tables are not those of version {version}"),
        Err(e) => e.to_string(),
    };
    Ok(vec![DamagedRecord { record: "the schema".into(), how }])
}

/// Rows whose checksum does not match.
fn rows(c: &Connection, table: &checksum::ChecksummedTable) -> Result<Vec<DamagedRecord>> {
    let (name, record, seal) = (table.name, table.record(""), table.seal(""));
    let select = format!("SELECT {record} AS record FROM main.{name} WHERE seal IS NOT {seal}");
    let row =
        |r: &Row| Ok(DamagedRecord { record: checksum::record(r), how: checksum::CHECKSUM_MISMATCH.into() });
    query(c, &select, [], row).or_else(|e| Ok(vec![DamagedRecord::of(failed(&format!("table {name}"), &e))?]))
}

/// Missing or damaged weights of policies.
fn references(c: &Connection, blobs: &Blobs, weights: WeightsCheck) -> Result<Vec<DamagedRecord>> {
    type WeightsRow = (String, String, String, i64);
    let select = "SELECT id, blob, digest, bytes FROM main.policy ORDER BY number";
    let row = |r: &Row| -> rusqlite::Result<WeightsRow> { Ok((r.get(0)?, r.get(1)?, r.get(2)?, r.get(3)?)) };
    // Unreadable rows were reported before.
    let Ok(policies) = query(c, select, [], row) else { return Ok(Vec::new()) };
    let mut found = Vec::new();
    for (id, blob, digest, bytes) in policies {
        let how = match blobs.length(&blob)? {
            None => "the file is missing".to_string(),
            Some(length) if length != bytes as u64 => format!("{length} bytes of {bytes}"),
            Some(_) if weights == WeightsCheck::Size => continue,
            Some(_) if blobs.digest(&blob)?.as_deref() == Some(&digest) => continue,
            Some(_) => "the SHA-256 does not match".to_string(),
        };
        found.push(DamagedRecord { record: format!("weights of policy {id} ({blob})"), how });
    }
    Ok(found)
}

/// Rows that belong to removed jobs; they are harmless.
fn orphans(c: &Connection) -> Vec<String> {
    let of = |table: &str| {
        let select =
            format!("SELECT count(*) FROM main.{table} WHERE job NOT IN (SELECT number FROM main.job)");
        c.query_row(&select, [], |r| r.get::<_, i64>(0)).unwrap_or(0)
    };
    let counted = schema::TABLES_OF_JOB.map(|table| (table, of(table)));
    let nonempty = counted.iter().filter(|(_, n)| *n > 0);
    nonempty
        .map(|(table, n)| format!("{n} rows of table {table} belong to removed jobs (harmless)"))
        .collect()
}

/// Errors if something is damaged.
pub fn refuse(found: &[DamagedRecord]) -> Result<()> {
    let Some(first) = found.first() else { return Ok(()) };
    let more = if found.len() > 1 { format!(" and {} more", found.len() - 1) } else { String::new() };
    Err(Error::Damaged { what: format!("{}{more}", first.record), how: first.how.clone() })
}

impl DamagedRecord {
    /// Converts the error of damaged data; other errors are returned.
    pub fn of(error: Error) -> Result<DamagedRecord> {
        match error {
            Error::Damaged { what, how } => Ok(DamagedRecord { record: what, how }),
            // SQLite rejects one of this program's statements: the schema is not the expected one.
            Error::Io { path, message } => Ok(DamagedRecord { record: path, how: message }),
            other => Err(other),
        }
    }
}
