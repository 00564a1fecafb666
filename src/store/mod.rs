//! Persistence: jobs with their rounds and measurements, worlds, policies and stored responses, in SQLite (WAL), with weights as
//! files.
//!
//! A data directory holds `iplw.sqlite`, `policies/`, `lock` and the token file (`layout`); only its owner can read it. One server
//! uses it at a time: it locks the directory, and the lock ends with the process. Files with other names are never changed. Without
//! a directory the same code keeps everything in memory.
//!
//! Reads return what was written, or an error that names the record: rows have checksums (`checksum`), weights digests (`blobs`),
//! and everything is checked when the store is opened (`check`). `backup` copies and restores; `salvage` recovers intact records.
//!
//! Writes are durable when they return, in one transaction, except [`Store::note_world`], which waits for the next
//! [`Store::flush_worlds`], and [`Store::note_line`], which waits for [`Store::flush_log`].

mod artifacts;
mod atomic_write;
mod backup;
mod blobs;
mod check;
mod checksum;
mod clock;
mod data_directory;
mod job_metadata;
mod jobs;
mod layout;
mod log;
mod log_line;
mod metadata_migration;
mod owner_usage;
mod permissions;
mod policies;
mod read_access;
mod requests;
mod rounds;
mod salvage;
mod schema;
mod sqlite;
mod surfaces;
mod worlds;
mod write_buffer;

#[cfg(test)]
mod damage;

use std::path::Path;
use std::sync::{Mutex, MutexGuard};

use rusqlite::{Connection, OptionalExtension, Params, Row, Transaction, TransactionBehavior};

use crate::error::Result;
use crate::sync::lock;
pub use atomic_write::{write_private, write_whole};
pub use backup::{backup, restore};
use blobs::Blobs;
use check::WeightsCheck;
pub use check::{CheckReport, DamagedRecord, LOCAL_AGENT, check, has_owned_records};
pub use checksum::sha256;
pub use clock::unix_ms;
pub use data_directory::refuse_foreign_files;
use data_directory::{DataDirectory, DirectoryLock, lock_directory};
pub use job_metadata::JobMetadata;
pub use jobs::{JobList, JobRow, JobState};
pub use log::{LogRow, MAX_LOG_LINES_PER_JOB};
pub use log_line::LogLevel;
use log_line::PendingLogLine;
pub use owner_usage::OwnerUsage;
pub use permissions::{make_directory as make_private_directory, open_lock_file, read_error};
pub use policies::PolicyRow;
pub use requests::StoredResponse;
pub use rounds::{MeasuredOutcomes, RoundRow};
pub use salvage::{SalvageReport, salvage};
use sqlite::{failed, json, query, sql};
pub use surfaces::SurfaceRow;
pub use worlds::WorldRow;
use write_buffer::WorldWriteBuffer;

/// An open store.
pub struct Store {
    connection: Mutex<Connection>,
    /// Counters of worlds that are not written yet.
    pending: Mutex<WorldWriteBuffer>,
    /// Held while they are written.
    writing: Mutex<()>,
    /// Lines of job logs that are not written yet.
    lines: Mutex<Vec<PendingLogLine>>,
    blobs: Blobs,
    /// Held while the store is open; `None` in memory.
    lock: Option<DirectoryLock>,
}

impl Store {
    /// A store in memory.
    pub fn in_memory() -> Result<Store> {
        let mut connection = Connection::open_in_memory().map_err(|e| failed("the store in memory", &e))?;
        checksum::register_function(&connection).map_err(sql)?;
        let blobs = Blobs::memory();
        schema::migrate(&mut connection, 0, &blobs).map_err(sql)?;
        checksum::install_guards(&connection).map_err(sql)?;
        Ok(Store::of(connection, blobs, None))
    }

    /// Opens or creates the store in `directory` and makes it private; errors if another server has it open, if its data are
    /// damaged, or if it holds other files and no data.
    pub fn open(directory: &Path) -> Result<Store> {
        refuse_foreign_files(directory)?;
        permissions::secure_data_directory(directory)?;
        let lock = lock_directory(directory)?;
        permissions::restrict_files(directory);
        let place = DataDirectory::at(directory);
        place.open_or_create_database()?;
        let mut connection = place.connect()?;
        let name = place.database.display().to_string();
        let fail = |e: rusqlite::Error| failed(&name, &e);
        check::refuse(&check::structure(&connection, &name)?)?;
        let version = schema::version(&connection, &name)?;
        check::refuse(&check::shape(&connection, version)?)?;
        // The pragma returns the resulting mode.
        connection.query_row("PRAGMA journal_mode = WAL", [], |row| row.get::<_, String>(0)).map_err(fail)?;
        connection.pragma_update(None, "synchronous", "FULL").map_err(fail)?;
        let blobs = Blobs::directory(&place.policies)?;
        schema::migrate(&mut connection, version, &blobs).map_err(fail)?;
        checksum::install_guards(&connection).map_err(fail)?;
        check::refuse(&check::content(&connection, schema::CURRENT_VERSION, &blobs, WeightsCheck::Size)?)?;
        let store = Store::of(connection, blobs, Some(lock));
        store.sweep_blobs()?;
        Ok(store)
    }

    fn of(connection: Connection, blobs: Blobs, lock: Option<DirectoryLock>) -> Store {
        Store {
            connection: Mutex::new(connection),
            pending: Mutex::default(),
            lines: Mutex::default(),
            writing: Mutex::default(),
            blobs,
            lock,
        }
    }

    /// Errors unless the data directory takes a durable write now: the disk may be full or read-only.
    pub fn probe_write(&self) -> Result<()> {
        self.lock.as_ref().map_or(Ok(()), |lock| atomic_write::probe_write(&lock.directory))
    }

    fn connection(&self) -> MutexGuard<'_, Connection> {
        lock(&self.connection)
    }

    /// Rows of a view with checksums, which are verified.
    fn rows<T>(
        &self,
        select: &str,
        with: impl Params,
        row: impl Fn(&Row) -> rusqlite::Result<T>,
    ) -> Result<Vec<T>> {
        let verified = |r: &Row| checksum::verify(r).and_then(|()| row(r));
        query(&self.connection(), select, with, verified).map_err(sql)
    }

    /// As [`Store::rows`], for at most one row.
    fn row<T>(
        &self,
        select: &str,
        with: impl Params,
        row: impl Fn(&Row) -> rusqlite::Result<T>,
    ) -> Result<Option<T>> {
        let verified = |r: &Row| checksum::verify(r).and_then(|()| row(r));
        self.connection().query_row(select, with, verified).optional().map_err(sql)
    }

    /// Runs a statement; returns the number of changed rows.
    fn execute(&self, statement: &str, with: impl Params) -> Result<usize> {
        self.connection().execute(statement, with).map_err(sql)
    }

    /// Runs `write` in a transaction.
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
    fn rejects_second_server() {
        let dir = tempfile::tempdir().unwrap();
        let first = Store::open(dir.path()).unwrap();
        let refused = Store::open(dir.path()).err().unwrap();
        assert!(refused.to_string().contains("in use by another server"), "{refused}");
        drop(first);
        Store::open(dir.path()).unwrap();
    }

    #[test]
    fn rejects_later_schema() {
        let dir = tempfile::tempdir().unwrap();
        Store::open(dir.path()).unwrap().connection().pragma_update(None, "user_version", 99).unwrap();
        let refused = Store::open(dir.path()).err().unwrap();
        assert!(refused.to_string().contains("later version"), "{refused}");
    }
}
