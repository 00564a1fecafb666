//! What lasts: jobs with their rounds and measurements, worlds, policies and answered requests, in SQLite (WAL)
//! with weights as files beside it.
//!
//! A data directory holds `iplw.sqlite`, `policies/` and `lock`. One server at a time: the lock is the
//! operating system's, so it goes with the process however that ends. Without a directory everything is kept
//! in memory by the same code.
//!
//! What a function here wrote is on the disk when it returns, in one transaction, but for [`Store::note_world`],
//! which waits for the next [`Store::flush_worlds`].

mod artifacts;
mod blobs;
mod jobs;
mod pending;
mod policies;
mod requests;
mod rounds;
mod surfaces;
mod whole;
mod worlds;

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use rusqlite::{Connection, Transaction, TransactionBehavior};

use crate::error::{Error, Result};
use blobs::Blobs;
pub use jobs::{JobList, JobRow, JobState};
use pending::Pending;
pub use policies::PolicyRow;
pub use requests::Answered;
pub use rounds::{Measured, RoundRow};
pub use surfaces::SurfaceRow;
pub use whole::{write_private, write_whole};
pub use worlds::WorldRow;

/// An open store.
pub struct Store {
    connection: Mutex<Connection>,
    /// Counters of worlds that are not written yet.
    pending: Mutex<Pending>,
    /// Held by whoever writes them.
    writing: Mutex<()>,
    blobs: Blobs,
    /// Held as long as the store is open.
    _lock: Option<File>,
}

/// What makes the tables, step by step; a file that has had the first n is of version n.
const STEPS: [&str; 4] = [
    "
    CREATE TABLE job (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        kind TEXT NOT NULL,
        state TEXT NOT NULL,
        config TEXT NOT NULL,
        result TEXT,
        error TEXT,
        seed TEXT NOT NULL,
        version TEXT NOT NULL,
        stage TEXT NOT NULL DEFAULT '',
        done INTEGER NOT NULL DEFAULT 0,
        total INTEGER NOT NULL DEFAULT 0,
        events INTEGER NOT NULL DEFAULT 0
    ) STRICT;
    CREATE TABLE policy (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        id TEXT NOT NULL UNIQUE,
        task TEXT NOT NULL,
        training TEXT NOT NULL,
        about TEXT NOT NULL,
        config TEXT NOT NULL,
        job TEXT,
        version TEXT NOT NULL,
        blob TEXT NOT NULL,
        bytes INTEGER NOT NULL
    ) STRICT;
",
    "
    ALTER TABLE job ADD COLUMN plan TEXT;
    ALTER TABLE job ADD COLUMN starts INTEGER NOT NULL DEFAULT 0;
    CREATE TABLE round (
        job INTEGER NOT NULL,
        number INTEGER NOT NULL,
        asked TEXT NOT NULL,
        done TEXT,
        PRIMARY KEY (job, number)
    ) STRICT;
    CREATE TABLE measured (
        job INTEGER NOT NULL,
        number INTEGER NOT NULL,
        outcome TEXT,
        PRIMARY KEY (job, number)
    ) STRICT;
    CREATE TABLE artifact (
        job INTEGER NOT NULL,
        name TEXT NOT NULL,
        body BLOB NOT NULL,
        PRIMARY KEY (job, name)
    ) STRICT;
    CREATE TABLE world (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        id TEXT NOT NULL UNIQUE,
        config TEXT NOT NULL,
        latents TEXT,
        interactions INTEGER NOT NULL DEFAULT 0
    ) STRICT;
    CREATE TABLE request (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        key TEXT NOT NULL UNIQUE,
        fingerprint TEXT NOT NULL,
        status INTEGER NOT NULL,
        location TEXT,
        body BLOB NOT NULL
    ) STRICT;
",
    "
    CREATE TABLE surface (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        task TEXT NOT NULL,
        config TEXT NOT NULL,
        body TEXT NOT NULL,
        job TEXT,
        version TEXT NOT NULL,
        UNIQUE (task, config)
    ) STRICT;
",
    "
    ALTER TABLE job ADD COLUMN owner TEXT;
    ALTER TABLE policy ADD COLUMN owner TEXT;
    ALTER TABLE world ADD COLUMN owner TEXT;
",
];

impl Store {
    /// A store that is gone when it is dropped.
    pub fn in_memory() -> Result<Store> {
        let connection = Connection::open_in_memory().map_err(|e| failed("the store in memory", &e))?;
        Store::of(connection, Blobs::memory(), None).ready(":memory:")
    }

    /// Opens or makes the store in `directory`; refuses if another server has it open.
    pub fn open(directory: &Path) -> Result<Store> {
        std::fs::create_dir_all(directory).map_err(|e| Error::io(directory, e))?;
        let lock = locked(directory)?;
        let file = directory.join("iplw.sqlite");
        let place = file.display().to_string();
        let connection = Connection::open(&file).map_err(|e| failed(&place, &e))?;
        let blobs = Blobs::directory(&directory.join("policies"))?;
        Store::of(connection, blobs, Some(lock)).ready(&place)
    }

    fn of(connection: Connection, blobs: Blobs, lock: Option<File>) -> Store {
        Store {
            connection: Mutex::new(connection),
            pending: Mutex::default(),
            writing: Mutex::default(),
            blobs,
            _lock: lock,
        }
    }

    fn ready(self, place: &str) -> Result<Store> {
        {
            let c = self.connection();
            let fail = |e: rusqlite::Error| failed(place, &e);
            // A database in memory has no log; the pragma's answer is the mode that holds.
            c.query_row("PRAGMA journal_mode = WAL", [], |row| row.get::<_, String>(0)).map_err(fail)?;
            c.pragma_update(None, "synchronous", "FULL").map_err(fail)?;
            let version: i64 = c.query_row("PRAGMA user_version", [], |row| row.get(0)).map_err(fail)?;
            let here = STEPS.len() as i64;
            if !(0..=here).contains(&version) {
                return Err(Error::Refused {
                    reason: format!(
                        "{place} was written by a later version of this program (tables {version}, \
                         here {here}); use that version, or another data directory"
                    ),
                });
            }
            if version < here {
                let missing = STEPS[version as usize..].concat();
                c.execute_batch(&format!("BEGIN; {missing} PRAGMA user_version = {here}; COMMIT;"))
                    .map_err(fail)?;
            }
        }
        self.sweep_blobs()?;
        Ok(self)
    }

    fn connection(&self) -> MutexGuard<'_, Connection> {
        self.connection.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// All of what `write` does, or nothing.
    fn atomically<T>(&self, write: impl FnOnce(&Transaction) -> rusqlite::Result<T>) -> Result<T> {
        let mut c = self.connection();
        let transaction = c.transaction_with_behavior(TransactionBehavior::Immediate).map_err(sql)?;
        let done = write(&transaction).map_err(sql)?;
        transaction.commit().map_err(sql)?;
        Ok(done)
    }
}

/// Takes the directory's lock and writes this process's number into it.
fn locked(directory: &Path) -> Result<File> {
    let path = directory.join("lock");
    let mut file = OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .open(&path)
        .map_err(|e| Error::io(&path, e))?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            let mut owner = String::new();
            // Who it is only makes the message better; that someone has it is known.
            let _ = file.read_to_string(&mut owner);
            let owner =
                if owner.trim().is_empty() { String::new() } else { format!(" (process {})", owner.trim()) };
            return Err(Error::Refused {
                reason: format!(
                    "data directory {} is in use by another server{owner}; stop that one, or give another --data-dir",
                    directory.display()
                ),
            });
        }
        Err(TryLockError::Error(e)) => return Err(Error::io(&path, e)),
    }
    file.set_len(0).map_err(|e| Error::io(&path, e))?;
    writeln!(file, "{}", std::process::id()).map_err(|e| Error::io(&path, e))?;
    Ok(file)
}

fn failed(place: &str, error: &rusqlite::Error) -> Error {
    Error::Io { path: place.to_string(), message: error.to_string() }
}

fn sql(error: rusqlite::Error) -> Error {
    failed("the store", &error)
}

/// JSON that this program wrote itself.
fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or(serde_json::Value::Null)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_server_is_refused_until_the_first_is_gone() {
        let dir = tempfile::tempdir().unwrap();
        let first = Store::open(dir.path()).unwrap();
        let refused = Store::open(dir.path()).err().unwrap();
        assert!(refused.to_string().contains("in use by another server"), "{refused}");
        drop(first);
        Store::open(dir.path()).unwrap();
    }

    #[test]
    fn an_older_file_gains_the_tables_it_lacks() {
        let dir = tempfile::tempdir().unwrap();
        let old = Connection::open(dir.path().join("iplw.sqlite")).unwrap();
        old.execute_batch(&format!("{} PRAGMA user_version = 1;", STEPS[0])).unwrap();
        let insert =
            "INSERT INTO job (kind, state, config, seed, version) VALUES ('iplw', 'running', '{}', '1', '0')";
        old.execute_batch(insert).unwrap();
        drop(old);
        for _ in 0..2 {
            let store = Store::open(dir.path()).unwrap();
            let job = &store.unfinished().unwrap()[0];
            assert_eq!((job.number, job.starts, &job.plan), (1, 0, &serde_json::Value::Null));
            assert!(store.worlds().unwrap().is_empty());
        }
    }

    #[test]
    fn a_later_schema_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        Store::open(dir.path()).unwrap().connection().pragma_update(None, "user_version", 99).unwrap();
        let refused = Store::open(dir.path()).err().unwrap();
        assert!(refused.to_string().contains("later version"), "{refused}");
    }
}
