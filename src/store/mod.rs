//! What lasts: jobs with their rounds and measurements, worlds, policies and answered requests, in SQLite (WAL)
//! with weights as files beside it.
//!
//! A data directory holds `iplw.sqlite`, `policies/`, `lock` and what `access/` keeps there; its owner alone may read it. One server
//! at a time: the lock is the operating system's, so it goes with the process however that ends. Without a directory everything is
//! kept in memory by the same code.
//!
//! What comes out is what went in, or an error that names the record: rows have checksums (`seal`), weights digests (`blobs`), and
//! all is looked at when the store is opened (`check`). `backup` copies and restores, `salvage` saves what is whole.
//!
//! What a function here wrote is on the disk when it returns, in one transaction, but for [`Store::note_world`],
//! which waits for the next [`Store::flush_worlds`], and [`Store::note_line`], which does for [`Store::flush_log`].

mod artifacts;
mod backup;
mod blobs;
mod check;
mod jobs;
mod log;
mod noted;
mod pending;
mod place;
mod policies;
mod private;
mod requests;
mod rounds;
mod salvage;
mod schema;
mod seal;
mod sqlite;
mod surfaces;
mod whole;
mod worlds;

#[cfg(test)]
mod damage;

use std::fs::File;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use rusqlite::{Connection, Transaction, TransactionBehavior};

use crate::error::Result;
pub use backup::{backup, restore};
use blobs::Blobs;
use check::Weights;
pub use check::{Checked, Finding, check};
pub use jobs::{JobList, JobRow, JobState};
pub use log::{KEPT_LINES, LogRow};
pub use noted::Level;
use noted::Noted;
use pending::Pending;
use place::{Place, locked};
pub use policies::PolicyRow;
pub use private::{make_directory as make_private_directory, options as private_file};
pub use requests::Answered;
pub use rounds::{Measured, RoundRow};
pub use salvage::{Salvaged, salvage};
pub use seal::sha256;
use sqlite::{failed, json, sql};
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
    /// Lines of jobs' logs that are not written yet.
    lines: Mutex<Vec<Noted>>,
    blobs: Blobs,
    /// Held as long as the store is open.
    _lock: Option<File>,
}

impl Store {
    /// A store that is gone when it is dropped.
    pub fn in_memory() -> Result<Store> {
        let mut connection = Connection::open_in_memory().map_err(|e| failed("the store in memory", &e))?;
        seal::teach(&connection).map_err(sql)?;
        let blobs = Blobs::memory();
        schema::migrate(&mut connection, 0, &blobs).map_err(sql)?;
        seal::guard(&connection).map_err(sql)?;
        Ok(Store::of(connection, blobs, None))
    }

    /// Opens or makes the store in `directory`, which nobody else may read then; refuses if another server has it open, or if
    /// what is in it is damaged.
    pub fn open(directory: &Path) -> Result<Store> {
        private::own_directory(directory)?;
        let lock = locked(directory)?;
        private::tighten(directory);
        let place = Place::at(directory);
        place.whole_or_new()?;
        let mut connection = place.connect()?;
        let name = place.database.display().to_string();
        let fail = |e: rusqlite::Error| failed(&name, &e);
        check::refuse(&check::structure(&connection, &name)?)?;
        let version = schema::version(&connection, &name)?;
        check::refuse(&check::shape(&connection, version)?)?;
        // The pragma's answer is the mode that holds.
        connection.query_row("PRAGMA journal_mode = WAL", [], |row| row.get::<_, String>(0)).map_err(fail)?;
        connection.pragma_update(None, "synchronous", "FULL").map_err(fail)?;
        let blobs = Blobs::directory(&place.policies)?;
        schema::migrate(&mut connection, version, &blobs).map_err(fail)?;
        seal::guard(&connection).map_err(fail)?;
        check::refuse(&check::content(&connection, schema::HERE, &blobs, Weights::Size)?)?;
        let store = Store::of(connection, blobs, Some(lock));
        store.sweep_blobs()?;
        Ok(store)
    }

    fn of(connection: Connection, blobs: Blobs, lock: Option<File>) -> Store {
        Store {
            connection: Mutex::new(connection),
            pending: Mutex::default(),
            lines: Mutex::default(),
            writing: Mutex::default(),
            blobs,
            _lock: lock,
        }
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
    fn a_later_schema_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        Store::open(dir.path()).unwrap().connection().pragma_update(None, "user_version", 99).unwrap();
        let refused = Store::open(dir.path()).err().unwrap();
        assert!(refused.to_string().contains("later version"), "{refused}");
    }
}
