//! Recovery of the intact records of a damaged data directory into a new database.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use rusqlite::types::{Value, ValueRef};
use rusqlite::{Connection, Transaction, params_from_iter};

use super::blobs::Blobs;
use super::check::DamagedRecord;
use super::data_directory::{DataDirectory, lock_directory};
use super::sqlite::{failed, query};
use super::{atomic_write, checksum, metadata_migration, permissions, schema};
use crate::error::{Error, Result};

/// Result of a salvage.
#[derive(Clone, Debug, PartialEq)]
pub struct SalvageReport {
    /// Records that were dropped.
    pub dropped: Vec<DamagedRecord>,
    /// Path of the damaged database, kept.
    pub damaged_copy: PathBuf,
}

/// Larger sequence numbers are taken for damage.
const MAX_SEQUENCE_NUMBER: i64 = 1 << 40;

/// Copies all intact records into a new database. A job is dropped entirely, with its measurements, if any part of it is damaged.
/// The old database is kept next to the new one.
pub fn salvage(directory: &Path) -> Result<SalvageReport> {
    let place = DataDirectory::at(directory);
    place.check_exists()?;
    let _lock = lock_directory(directory)?;
    permissions::restrict_files(directory);
    let name = place.database.display().to_string();
    let old = place.connect()?;
    let version = schema::version(&old, &name)?;
    if version < schema::FIRST_CHECKSUM_VERSION {
        let reason = format!(
            "{name} has no checksums (an older version), so intact rows cannot be recognised; restore a backup"
        );
        return Err(Error::Refused { reason });
    }
    let part = place.database.with_extension("sqlite.salvaged");
    let dropped = place.create_database(&part).and_then(|()| {
        let fail = |e: rusqlite::Error| failed(&part.display().to_string(), &e);
        let mut new = Connection::open(&part).map_err(fail)?;
        checksum::register_function(&new).map_err(fail)?;
        let t = new.transaction().map_err(fail)?;
        let dropped = copy_intact_records(&old, version, &t, &Blobs::Directory(place.policies.clone()))
            .map_err(fail)?;
        t.commit().map_err(fail)?;
        new.close().map_err(|(_, e)| fail(e))?;
        Ok(dropped)
    });
    let dropped = dropped.inspect_err(|_| drop(fs::remove_file(&part)))?;
    // The write-ahead log may remain; it is kept too.
    drop(old);
    let damaged_copy = put_aside(&place.database)?;
    atomic_write::rename_into_place(&part, &place.database)?;
    Ok(SalvageReport { dropped, damaged_copy })
}

/// Copies intact records; returns the dropped ones.
fn copy_intact_records(
    old: &Connection,
    version: i64,
    new: &Transaction,
    blobs: &Blobs,
) -> rusqlite::Result<Vec<DamagedRecord>> {
    let (mut dropped, mut incomplete) = (Vec::new(), BTreeSet::new());
    for table in checksum::tables(version) {
        let mut damaged_records = BTreeSet::new();
        // From both ends, because an unreadable page ends a scan.
        for order in ["ASC", "DESC"] {
            if let Err(e) = copy_rows(old, new, table, order, &mut damaged_records, &mut incomplete) {
                let record = format!("table {}", table.name);
                let how = format!("some rows cannot be read: {e}");
                dropped.push(DamagedRecord { record, how });
            } else {
                break;
            }
        }
        dropped.extend(
            damaged_records
                .into_iter()
                .map(|record| DamagedRecord { record, how: checksum::CHECKSUM_MISMATCH.into() }),
        );
    }
    for job in incomplete {
        if new.execute("DELETE FROM job WHERE number = ?1", [job])? > 0 {
            let how = "a measurement or artifact of it is damaged".into();
            dropped.push(DamagedRecord { record: format!("job job-{job}"), how });
        }
    }
    // Earlier versions have none, and a page of them may be unreadable.
    metadata_migration::add_missing(new)?;
    for part in schema::TABLES_OF_JOB {
        new.execute(&format!("DELETE FROM {part} WHERE job NOT IN (SELECT number FROM job)"), [])?;
    }
    dropped.extend(drop_policies_without_weights(new, blobs)?);
    continue_sequences(old, new)?;
    Ok(dropped)
}

/// Copies the intact rows of a table in this order, up to an unreadable page. Collects the names of damaged rows, and the jobs that
/// they belong to.
fn copy_rows(
    old: &Connection,
    new: &Transaction,
    table: &checksum::ChecksummedTable,
    order: &str,
    damaged: &mut BTreeSet<String>,
    incomplete: &mut BTreeSet<i64>,
) -> rusqlite::Result<()> {
    let (name, columns) = (table.name, table.columns.join(", "));
    let (seal, record) = (table.seal(""), table.record(""));
    // A job is complete without a log line.
    let part = table.columns[0] == "job" && name != "log";
    let select = format!(
        "SELECT {columns}, seal, seal IS {seal} AS whole, {record} AS record FROM main.{name} NOT INDEXED \
         ORDER BY rowid {order}"
    );
    let count = table.columns.len() + 1;
    let places = vec!["?"; count].join(", ");
    // Checksums are copied, not recomputed.
    let mut insert =
        new.prepare(&format!("INSERT OR IGNORE INTO {name} ({columns}, seal) VALUES ({places})"))?;
    let mut query = old.prepare(&select)?;
    let mut all = query.query([])?;
    while let Some(row) = all.next()? {
        if row.get_ref("whole")? == ValueRef::Integer(1) {
            let values = (0..count).map(|i| row.get::<_, Value>(i)).collect::<rusqlite::Result<Vec<_>>>()?;
            insert.execute(params_from_iter(values))?;
        } else {
            damaged.insert(checksum::record(row));
            if part && let ValueRef::Integer(job) = row.get_ref(0)? {
                incomplete.insert(job);
            }
        }
    }
    Ok(())
}

/// Drops policies whose weights are damaged.
fn drop_policies_without_weights(new: &Transaction, blobs: &Blobs) -> rusqlite::Result<Vec<DamagedRecord>> {
    let select = "SELECT id, blob, digest FROM policy ORDER BY number";
    let policies: Vec<(String, String, String)> =
        query(new, select, [], |r| Ok((r.get(0)?, r.get(1)?, r.get(2)?)))?;
    let mut dropped = Vec::new();
    for (id, blob, digest) in policies {
        if blobs.digest(&blob).ok().flatten().as_deref() != Some(&digest) {
            new.execute("DELETE FROM policy WHERE id = ?1", [&id])?;
            dropped.push(DamagedRecord {
                record: format!("policy {id}"),
                how: "its weights are damaged or missing".into(),
            });
        }
    }
    Ok(dropped)
}

/// Continues the number sequences, also after the last rows were dropped.
fn continue_sequences(old: &Connection, new: &Transaction) -> rusqlite::Result<()> {
    let select = "SELECT name, seq FROM main.sqlite_sequence";
    let last = query(old, select, [], |r| Ok((r.get::<_, String>(0)?, r.get::<_, i64>(1)?)));
    for (name, number) in last.unwrap_or_default() {
        let is_known = checksum::TABLES.iter().any(|t| t.name == name);
        if is_known && (0..MAX_SEQUENCE_NUMBER).contains(&number) {
            new.execute(
                "INSERT INTO sqlite_sequence (name, seq) SELECT ?1, 0 WHERE ?1 NOT IN (SELECT name FROM sqlite_sequence)",
                [&name],
            )?;
            new.execute(
                "UPDATE sqlite_sequence SET seq = max(seq, ?2) WHERE name = ?1",
                rusqlite::params![name, number],
            )?;
        }
    }
    Ok(())
}

/// Renames the damaged database and its companion files to unused names.
fn put_aside(database: &Path) -> Result<PathBuf> {
    let named = |i: usize| {
        database.with_extension(if i == 0 { "sqlite.damaged".into() } else { format!("sqlite.damaged.{i}") })
    };
    let target = (0..).map(named).find(|p| fs::symlink_metadata(p).is_err()).unwrap_or_else(|| named(0));
    for beside in ["-wal", "-shm", "-journal", ""] {
        let (from, to) = (format!("{}{beside}", database.display()), format!("{}{beside}", target.display()));
        match fs::rename(&from, &to) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound || beside.is_empty() => {
                return Err(Error::io(Path::new(&from), e));
            }
            _ => {}
        }
    }
    Ok(target)
}
