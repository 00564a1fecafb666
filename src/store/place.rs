//! A data directory: what is where in it, who has it, and its database.

use std::fs::{self, File, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use rusqlite::{Connection, OpenFlags};

use super::blobs::Blobs;
use super::sqlite::failed;
use super::{private, schema, seal, whole};
use crate::error::{Error, Result};

/// Where the parts of a data directory are.
pub struct Place {
    pub directory: PathBuf,
    pub database: PathBuf,
    pub policies: PathBuf,
    pub tokens: PathBuf,
    /// There while a restore is under way: what else is there is neither the old nor the new.
    pub restoring: PathBuf,
}

impl Place {
    pub fn at(directory: &Path) -> Place {
        Place {
            directory: directory.to_path_buf(),
            database: directory.join("iplw.sqlite"),
            policies: directory.join("policies"),
            tokens: directory.join("tokens.json"),
            restoring: directory.join("restoring"),
        }
    }

    /// Makes an empty database where there never was one; errors if one is gone.
    pub fn whole_or_new(&self) -> Result<()> {
        self.restored()?;
        if self.database.exists() {
            return self.there();
        }
        let weights = fs::read_dir(&self.policies).into_iter().flatten().flatten();
        if weights.into_iter().any(|e| e.path().extension().is_some_and(|e| e == "safetensors")) {
            return Err(self.damaged("it is gone, though there are weights of policies beside it"));
        }
        self.make(&self.database)
    }

    /// Errors unless there is a database that has something in it.
    pub fn there(&self) -> Result<()> {
        self.restored()?;
        match fs::metadata(&self.database) {
            // SQLite takes an empty file for a new database.
            Ok(file) if file.len() == 0 => Err(self.damaged("the file is empty")),
            Ok(_) => Ok(()),
            Err(e) => Err(Error::io(&self.database, e)),
        }
    }

    fn restored(&self) -> Result<()> {
        if !self.restoring.exists() {
            return Ok(());
        }
        let reason = format!(
            "a restore into {} did not come to its end; do it again: `iplw restore BACKUP --to {0} --replace`",
            self.directory.display()
        );
        Err(Error::Refused { reason })
    }

    fn damaged(&self, how: &str) -> Error {
        Error::Damaged { what: self.database.display().to_string(), how: how.into() }
    }

    /// An empty database of this version under this name, all of it or nothing.
    pub fn make(&self, path: &Path) -> Result<()> {
        let part = path.with_extension("sqlite.part");
        for left in ["", "-journal", "-wal", "-shm"] {
            let _ = fs::remove_file(format!("{}{left}", part.display()));
        }
        private::options().write(true).open(&part).map_err(|e| Error::io(&part, e))?;
        let fail = |e: rusqlite::Error| failed(&part.display().to_string(), &e);
        let mut c = Connection::open(&part).map_err(fail)?;
        seal::teach(&c).map_err(fail)?;
        schema::migrate(&mut c, 0, &Blobs::memory()).map_err(fail)?;
        c.close().map_err(|(_, e)| fail(e))?;
        whole::named(&part, path)
    }

    /// A connection to the database, which is there. It knows seals; guards it gets when its tables are those of now.
    pub fn connect(&self) -> Result<Connection> {
        let name = self.database.display().to_string();
        let fail = |e: rusqlite::Error| failed(&name, &e);
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let c = Connection::open_with_flags(&self.database, flags).map_err(fail)?;
        seal::teach(&c).map_err(fail)?;
        Ok(c)
    }
}

/// Takes the directory's lock and writes this process's number into it.
pub fn locked(directory: &Path) -> Result<File> {
    let path = directory.join("lock");
    let mut file = private::options()
        .read(true)
        .write(true)
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
