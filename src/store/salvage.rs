//! What is still whole of a damaged data directory, in a new database.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use rusqlite::types::{Value, ValueRef};
use rusqlite::{Connection, Transaction, params_from_iter};

use super::blobs::Blobs;
use super::check::Finding;
use super::place::{Place, locked};
use super::sqlite::failed;
use super::{private, schema, seal, whole};
use crate::error::{Error, Result};

/// What became of a damaged data directory.
#[derive(Clone, Debug, PartialEq)]
pub struct Salvaged {
    /// What is not in it any more.
    pub dropped: Vec<Finding>,
    /// The damaged database, as it was.
    pub kept: PathBuf,
}

/// Numbers that nothing will ever reach are not taken over.
const MOST_NUMBER: i64 = 1 << 40;

/// Puts every record that is whole into a new database and leaves out the others. A job goes whole, with all that was measured
/// for it, if any part of it is damaged: half of a job is not what was stored. The old database stays beside the new one.
pub fn salvage(directory: &Path) -> Result<Salvaged> {
    let place = Place::at(directory);
    place.there()?;
    let _lock = locked(directory)?;
    private::tighten(directory);
    let name = place.database.display().to_string();
    let old = place.connect()?;
    let version = schema::version(&old, &name)?;
    if version < schema::SEALED {
        let reason = format!(
            "{name} is of a version without checksums: nobody can say which of its rows are whole; restore a backup"
        );
        return Err(Error::Refused { reason });
    }
    let part = place.database.with_extension("sqlite.salvaged");
    let dropped = place.make(&part).and_then(|()| {
        let fail = |e: rusqlite::Error| failed(&part.display().to_string(), &e);
        let mut new = Connection::open(&part).map_err(fail)?;
        let t = new.transaction().map_err(fail)?;
        let dropped =
            taken_over(&old, version, &t, &Blobs::Directory(place.policies.clone())).map_err(fail)?;
        t.commit().map_err(fail)?;
        new.close().map_err(|(_, e)| fail(e))?;
        Ok(dropped)
    });
    let dropped = dropped.inspect_err(|_| drop(fs::remove_file(&part)))?;
    // What closing cannot write back stays beside it.
    drop(old);
    let kept = put_aside(&place.database)?;
    whole::named(&part, &place.database)?;
    Ok(Salvaged { dropped, kept })
}

/// Copies what is whole; says what is not.
fn taken_over(
    old: &Connection,
    version: i64,
    new: &Transaction,
    blobs: &Blobs,
) -> rusqlite::Result<Vec<Finding>> {
    let (mut dropped, mut incomplete) = (Vec::new(), BTreeSet::new());
    for table in seal::tables(version) {
        let mut seen = BTreeSet::new();
        // From both ends, as a page that cannot be read ends the way.
        for order in ["ASC", "DESC"] {
            if let Err(e) = rows(old, new, table, order, &mut seen, &mut incomplete) {
                let record = format!("table {}", table.name);
                let how = format!("some of its rows cannot be read: {e}");
                dropped.push(Finding { record, how });
            } else {
                break;
            }
        }
        dropped.extend(seen.into_iter().map(|record| Finding { record, how: seal::OTHER.into() }));
    }
    for job in incomplete {
        if new.execute("DELETE FROM job WHERE number = ?1", [job])? > 0 {
            let how = "something that was measured for it or made by it is damaged".into();
            dropped.push(Finding { record: format!("job job-{job}"), how });
        }
    }
    for part in ["round", "measured", "artifact", "log"] {
        new.execute(&format!("DELETE FROM {part} WHERE job NOT IN (SELECT number FROM job)"), [])?;
    }
    dropped.extend(without_weights(new, blobs)?);
    numbers(old, new)?;
    Ok(dropped)
}

/// Copies the rows of a table that are whole, in this order, up to where they cannot be read. `damaged` are those that are not;
/// `incomplete` the jobs that these say they belong to.
fn rows(
    old: &Connection,
    new: &Transaction,
    table: &seal::Table,
    order: &str,
    damaged: &mut BTreeSet<String>,
    incomplete: &mut BTreeSet<i64>,
) -> rusqlite::Result<()> {
    let (name, columns) = (table.name, table.columns.join(", "));
    let (seal, record) = (table.seal(""), table.record(""));
    // A job is whole without a line of its log.
    let part = table.columns[0] == "job" && name != "log";
    let select = format!(
        "SELECT {columns}, seal, seal IS {seal} AS whole, {record} AS record FROM main.{name} NOT INDEXED \
         ORDER BY rowid {order}"
    );
    let count = table.columns.len() + 1;
    let places = vec!["?"; count].join(", ");
    // The checksums come along: these are not sealed anew.
    let mut insert =
        new.prepare(&format!("INSERT OR IGNORE INTO {name} ({columns}, seal) VALUES ({places})"))?;
    let mut query = old.prepare(&select)?;
    let mut all = query.query([])?;
    while let Some(row) = all.next()? {
        if row.get_ref("whole")? == ValueRef::Integer(1) {
            let values = (0..count).map(|i| row.get::<_, Value>(i)).collect::<rusqlite::Result<Vec<_>>>()?;
            insert.execute(params_from_iter(values))?;
        } else {
            damaged.insert(seal::record(row));
            if part && let ValueRef::Integer(job) = row.get_ref(0)? {
                incomplete.insert(job);
            }
        }
    }
    Ok(())
}

/// Drops policies whose weights are damaged.
fn without_weights(new: &Transaction, blobs: &Blobs) -> rusqlite::Result<Vec<Finding>> {
    let mut query = new.prepare("SELECT id, blob, digest FROM policy ORDER BY number")?;
    let policies: Vec<(String, String, String)> =
        query.query_map([], |r| Ok((r.get(0)?, r.get(1)?, r.get(2)?)))?.collect::<rusqlite::Result<_>>()?;
    let mut dropped = Vec::new();
    for (id, blob, digest) in policies {
        if blobs.digest(&blob).as_deref() != Some(&digest) {
            new.execute("DELETE FROM policy WHERE id = ?1", [&id])?;
            dropped.push(Finding {
                record: format!("policy {id}"),
                how: "its weights are damaged or gone".into(),
            });
        }
    }
    Ok(dropped)
}

/// Numbers that were given go on from where they were, also where the last of them are gone.
fn numbers(old: &Connection, new: &Transaction) -> rusqlite::Result<()> {
    let last = || -> rusqlite::Result<Vec<(String, i64)>> {
        let mut query = old.prepare("SELECT name, seq FROM main.sqlite_sequence")?;
        query.query_map([], |r| Ok((r.get(0)?, r.get(1)?)))?.collect()
    };
    for (name, number) in last().unwrap_or_default() {
        let known = seal::TABLES.iter().any(|t| t.name == name);
        if known && (0..MOST_NUMBER).contains(&number) {
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

/// Gives the damaged database, and what SQLite keeps beside it, a name that nothing has.
fn put_aside(database: &Path) -> Result<PathBuf> {
    let named = |i: usize| {
        database.with_extension(if i == 0 { "sqlite.damaged".into() } else { format!("sqlite.damaged.{i}") })
    };
    let kept = (0..).map(named).find(|p| !p.exists()).unwrap_or_else(|| named(0));
    for beside in ["-wal", "-shm", "-journal", ""] {
        let (from, to) = (format!("{}{beside}", database.display()), format!("{}{beside}", kept.display()));
        match fs::rename(&from, &to) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound || beside.is_empty() => {
                return Err(Error::io(Path::new(&from), e));
            }
            _ => {}
        }
    }
    Ok(kept)
}
