//! The data directory: its layout, its lock, and its database.

use std::fs::{self, File, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use rusqlite::{Connection, OpenFlags};

use super::blobs::Blobs;
use super::sqlite::failed;
use super::{atomic_write, checksum, permissions, schema};
use crate::error::{Error, Result};

/// Paths of a data directory.
pub struct DataDirectory {
    pub directory: PathBuf,
    pub database: PathBuf,
    pub policies: PathBuf,
    pub tokens: PathBuf,
    /// Exists while a restore is unfinished: then the other files may be old or new.
    pub restoring: PathBuf,
}

impl DataDirectory {
    pub fn at(directory: &Path) -> DataDirectory {
        DataDirectory {
            directory: directory.to_path_buf(),
            database: directory.join("iplw.sqlite"),
            policies: directory.join("policies"),
            tokens: directory.join("tokens.json"),
            restoring: directory.join("restoring"),
        }
    }

    /// Creates an empty database if there never was one; errors if one is missing.
    pub fn open_or_create_database(&self) -> Result<()> {
        self.check_no_unfinished_restore()?;
        if self.database.exists() {
            return self.check_exists();
        }
        let weights = fs::read_dir(&self.policies).into_iter().flatten().flatten();
        if weights.into_iter().any(|e| e.path().extension().is_some_and(|e| e == "safetensors")) {
            return Err(self.damaged("it is missing, although there are weights of policies"));
        }
        self.create_database(&self.database)
    }

    /// Errors unless there is a non-empty database.
    pub fn check_exists(&self) -> Result<()> {
        self.check_no_unfinished_restore()?;
        match fs::metadata(&self.database) {
            // SQLite takes an empty file for a new database.
            Ok(file) if file.len() == 0 => Err(self.damaged("the file is empty")),
            Ok(_) => Ok(()),
            Err(e) => Err(Error::io(&self.database, e)),
        }
    }

    fn check_no_unfinished_restore(&self) -> Result<()> {
        if !self.restoring.exists() {
            return Ok(());
        }
        let reason = format!(
            "a restore into {} was interrupted; repeat it: `iplw restore BACKUP --to {0} --replace`",
            self.directory.display()
        );
        Err(Error::Refused { reason })
    }

    fn damaged(&self, how: &str) -> Error {
        Error::Damaged { what: self.database.display().to_string(), how: how.into() }
    }

    /// Creates an empty database of the current version at this path, atomically.
    pub fn create_database(&self, path: &Path) -> Result<()> {
        let part = path.with_extension("sqlite.part");
        for left in ["", "-journal", "-wal", "-shm"] {
            let _ = fs::remove_file(format!("{}{left}", part.display()));
        }
        permissions::options().write(true).open(&part).map_err(|e| Error::io(&part, e))?;
        let fail = |e: rusqlite::Error| failed(&part.display().to_string(), &e);
        let mut c = Connection::open(&part).map_err(fail)?;
        checksum::register_function(&c).map_err(fail)?;
        schema::migrate(&mut c, 0, &Blobs::memory()).map_err(fail)?;
        c.close().map_err(|(_, e)| fail(e))?;
        atomic_write::rename_into_place(&part, path)
    }

    /// Connects to the existing database and registers the checksum function; guards are installed after migration.
    pub fn connect(&self) -> Result<Connection> {
        let name = self.database.display().to_string();
        let fail = |e: rusqlite::Error| failed(&name, &e);
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let c = Connection::open_with_flags(&self.database, flags).map_err(fail)?;
        checksum::register_function(&c).map_err(fail)?;
        Ok(c)
    }
}

/// Locks the directory and writes the process id into the lock file.
pub fn lock_directory(directory: &Path) -> Result<File> {
    let path = directory.join("lock");
    let mut file = permissions::options()
        .read(true)
        .write(true)
        .truncate(false)
        .open(&path)
        .map_err(|e| Error::io(&path, e))?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            let mut owner = String::new();
            // The process id only improves the message.
            let _ = file.read_to_string(&mut owner);
            let owner =
                if owner.trim().is_empty() { String::new() } else { format!(" (process {})", owner.trim()) };
            return Err(Error::Refused {
                reason: format!(
                    "data directory {} is in use by another server{owner}; stop it, or choose another --data-dir",
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
