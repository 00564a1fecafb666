//! The data directory: its layout, its lock, and its database.

use std::fs::{self, DirEntry, File, TryLockError};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use rusqlite::{Connection, OpenFlags};
use serde_json::Value;

use super::blobs::Blobs;
use super::sqlite::failed;
use super::{atomic_write, checksum, layout, permissions, schema};
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
            database: directory.join(layout::DATABASE),
            policies: directory.join(layout::POLICIES),
            tokens: directory.join(layout::TOKENS),
            restoring: directory.join(layout::RESTORING),
        }
    }

    /// Creates an empty database if there never was one; errors if one is missing.
    pub fn open_or_create_database(&self) -> Result<()> {
        self.check_no_unfinished_restore()?;
        if self.database.exists() {
            return self.check_exists();
        }
        let mut weights = fs::read_dir(&self.policies).into_iter().flatten().flatten();
        if weights.any(|e| e.file_name().to_str().is_some_and(layout::is_blob_name)) {
            return Err(self.damaged("it is missing, although there are weights of policies"));
        }
        if fs::metadata(self.companion("-wal")).is_ok_and(|log| log.len() > 0) {
            return Err(self.damaged("it is missing, although there is its log of transactions"));
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
            Err(e) => Err(permissions::read_error(&self.database, e)),
        }
    }

    /// A file of SQLite next to the database: `-wal`, `-shm` or `-journal`.
    pub fn companion(&self, ending: &str) -> PathBuf {
        let mut path = self.database.clone().into_os_string();
        path.push(ending);
        path.into()
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

/// The lock of a data directory; it belongs to the operating system and ends with the process.
pub struct DirectoryLock {
    pub directory: PathBuf,
    _file: File,
}

/// Locks the directory, and notes the process id for the message to other servers.
pub fn lock_directory(directory: &Path) -> Result<DirectoryLock> {
    let file = open_lock(directory)?;
    let process = directory.join(layout::PROCESS);
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            let id = fs::read_to_string(&process).ok().and_then(|text| text.trim().parse::<u32>().ok());
            let owner = id.map_or(String::new(), |id| format!(" (process {id})"));
            return Err(Error::Refused {
                reason: format!(
                    "data directory {} is in use by another server{owner}; stop it, or choose another --data-dir",
                    directory.display()
                ),
            });
        }
        Err(TryLockError::Error(e)) => return Err(Error::io(directory, e)),
    }
    // The process id only improves the message.
    let _ = atomic_write::write_private(&process, format!("{}\n", std::process::id()).as_bytes());
    Ok(DirectoryLock { directory: directory.to_path_buf(), _file: file })
}

/// The directory itself: a lock file could be removed while it is locked.
#[cfg(unix)]
fn open_lock(directory: &Path) -> Result<File> {
    File::open(directory).map_err(|e| Error::io(directory, e))
}

/// Directories cannot be locked on this platform.
#[cfg(not(unix))]
fn open_lock(directory: &Path) -> Result<File> {
    permissions::open_lock_file(&directory.join(layout::SERVER_LOCK))
}

/// Errors if `directory` has no database, but files that are not this program's: then it is no data directory.
pub fn refuse_foreign_files(directory: &Path) -> Result<()> {
    if fs::symlink_metadata(directory.join(layout::DATABASE)).is_ok() {
        return Ok(());
    }
    let entries = match fs::read_dir(directory) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(()),
        entries => entries.and_then(Iterator::collect::<io::Result<Vec<DirEntry>>>),
    };
    let entries = entries.map_err(|e| Error::io(directory, e))?;
    let foreign = entries.iter().filter(|e| !is_own_entry(e)).map(|e| e.file_name()).min();
    foreign.map_or(Ok(()), |name| {
        let reason = format!(
            "{} is no data directory: it has other files, such as {}; choose a new or empty directory",
            directory.display(),
            name.display()
        );
        Err(Error::Refused { reason })
    })
}

fn is_own_entry(entry: &DirEntry) -> bool {
    let (path, name) = (entry.path(), entry.file_name());
    let (Some(name), Ok(kind)) = (name.to_str(), entry.file_type()) else { return false };
    let is_blob = |e: io::Result<DirEntry>| {
        e.is_ok_and(|e| {
            e.file_type().is_ok_and(|t| t.is_file())
                && e.file_name().to_str().is_some_and(layout::is_blob_name)
        })
    };
    match name {
        // Of the file system, at the root of a volume.
        "lost+found" | layout::RESTORED => kind.is_dir(),
        layout::POLICIES => kind.is_dir() && fs::read_dir(&path).is_ok_and(|mut all| all.all(is_blob)),
        layout::TOKENS => kind.is_file() && is_token_file(&path),
        _ => kind.is_file() && layout::is_own_name(name),
    }
}

/// Whether a file has the format of tokens; `access` reads them.
fn is_token_file(path: &Path) -> bool {
    let document = fs::read(path).ok().and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok());
    document.is_some_and(|d| d["format"] == "iplw.tokens/1")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Store;

    #[test]
    fn removal_of_files_does_not_end_the_lock() {
        let place = tempfile::tempdir().unwrap();
        let first = Store::open(place.path()).unwrap();
        let refused = |expected: &str| {
            let error = Store::open(place.path()).err().unwrap().to_string();
            assert!(error.contains("in use by another server") && error.contains(expected), "{error}");
        };
        refused(&format!("(process {})", std::process::id()));
        fs::remove_file(place.path().join(layout::PROCESS)).unwrap();
        refused("server;");
        drop(first);
        Store::open(place.path()).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn lock_is_not_written_through_links() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        drop(Store::open(&at("data")).unwrap());
        fs::write(at("target"), "old").unwrap();
        fs::remove_file(at("data").join(layout::PROCESS)).unwrap();
        std::os::unix::fs::symlink(at("target"), at("data").join(layout::PROCESS)).unwrap();
        let _store = Store::open(&at("data")).unwrap();
        assert_eq!(fs::read_to_string(at("target")).unwrap(), "old");
        assert!(Store::open(&at("data")).is_err());
    }

    #[test]
    fn log_without_database_is_damage() {
        let place = tempfile::tempdir().unwrap();
        fs::write(place.path().join("iplw.sqlite-wal"), "transactions").unwrap();
        let error = Store::open(place.path()).err().unwrap();
        assert!(matches!(error, Error::Damaged { .. }), "{error}");
    }
}
