//! Read access to a database, also for users who may not write to its directory.
//!
//! SQLite shares the state of its log with writers through a file in the directory, which it creates if necessary. Without a log
//! the database is opened as immutable, which needs no such file; with a log that cannot be shared, a private copy is opened.

use std::fs::{self, DirBuilder, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rusqlite::{Connection, ErrorCode, OpenFlags};

use super::data_directory::DataDirectory;
use super::sqlite::failed;
use super::{checksum, permissions};
use crate::error::{Error, Result};

/// How to open a database.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReadAccess {
    /// The file itself, read-only.
    InPlace,
    /// A copy in the directory of temporary files.
    Copy,
}

/// A connection that never changes the data directory.
pub struct DatabaseReader {
    pub connection: Connection,
    _copy: Option<PrivateCopy>,
}

/// A directory with a copy of the database, removed when dropped.
struct PrivateCopy(PathBuf);

impl Drop for PrivateCopy {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Maximum attempts to copy a database that changes meanwhile.
const MAX_COPY_ATTEMPTS: usize = 10;

/// Opens the database in place if SQLite can do so, and otherwise a copy.
pub fn open_to_read(place: &DataDirectory) -> Result<DatabaseReader> {
    // SQLite does not distinguish a missing permission from other failures.
    File::open(&place.database).map_err(|e| permissions::read_error(&place.database, e))?;
    match open(place, ReadAccess::InPlace) {
        Err(OpenError::NeedsWrite) => open(place, ReadAccess::Copy),
        opened => opened,
    }
    .map_err(|e| match e {
        OpenError::NeedsWrite => Error::Io {
            path: place.database.display().to_string(),
            message: "its copy cannot be opened".into(),
        },
        OpenError::Other(e) => e,
    })
}

/// Why a database was not opened.
#[derive(Debug)]
enum OpenError {
    /// SQLite needs to write to the directory.
    NeedsWrite,
    Other(Error),
}

fn open(place: &DataDirectory, access: ReadAccess) -> std::result::Result<DatabaseReader, OpenError> {
    let name = place.database.display().to_string();
    let convert = |e: rusqlite::Error| match e.sqlite_error_code() {
        Some(ErrorCode::CannotOpen | ErrorCode::ReadOnly | ErrorCode::PermissionDenied) => {
            OpenError::NeedsWrite
        }
        _ => OpenError::Other(failed(&name, &e)),
    };
    let (connection, copy) = match access {
        ReadAccess::InPlace => (open_in_place(place).map_err(convert)?, None),
        ReadAccess::Copy => {
            let copy = copy_database(place).map_err(OpenError::Other)?;
            let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
            let path = DataDirectory::at(&copy.0).database;
            (Connection::open_with_flags(path, flags).map_err(convert)?, Some(copy))
        }
    };
    checksum::register_function(&connection).map_err(convert)?;
    // SQLite opens the files at the first query.
    connection.query_row("SELECT count(*) FROM sqlite_schema", [], |_| Ok(())).map_err(convert)?;
    Ok(DatabaseReader { connection, _copy: copy })
}

fn open_in_place(place: &DataDirectory) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let has_log = ["-wal", "-journal"].iter().any(|ending| place.companion(ending).exists());
    if has_log || cfg!(not(unix)) {
        return Connection::open_with_flags(&place.database, flags);
    }
    // In a URI, a path has no other characters.
    let escape = |byte: &u8| match byte {
        b'/' | b'.' | b'-' | b'_' => char::from(*byte).to_string(),
        _ if byte.is_ascii_alphanumeric() => char::from(*byte).to_string(),
        _ => format!("%{byte:02X}"),
    };
    let path: String = place.database.as_os_str().as_encoded_bytes().iter().map(escape).collect();
    Connection::open_with_flags(format!("file:{path}?immutable=1"), flags | OpenFlags::SQLITE_OPEN_URI)
}

/// Copies the database with its log, of one moment.
fn copy_database(place: &DataDirectory) -> Result<PrivateCopy> {
    let copy = temporary_directory()?;
    let target = DataDirectory::at(&copy.0);
    for _ in 0..MAX_COPY_ATTEMPTS {
        let files =
            ["", "-wal", "-journal"].map(|ending| (place.companion(ending), target.companion(ending)));
        let before: Vec<_> = files.iter().map(|(from, _)| stamp(from)).collect();
        for (from, to) in &files {
            copy_file(from, to).map_err(|e| permissions::read_error(from, e))?;
        }
        if before.iter().zip(&files).all(|(stamp_before, (from, _))| *stamp_before == stamp(from)) {
            return Ok(copy);
        }
    }
    let reason = format!(
        "{} changed {MAX_COPY_ATTEMPTS} times while it was copied; run the command as the user of the server",
        place.database.display()
    );
    Err(Error::Refused { reason })
}

/// Modification time and size.
fn stamp(path: &Path) -> Option<(Option<SystemTime>, u64)> {
    fs::metadata(path).ok().map(|m| (m.modified().ok(), m.len()))
}

/// Copies a file, whose permissions may forbid writing; removes the copy if there is no file.
fn copy_file(from: &Path, to: &Path) -> io::Result<()> {
    match File::open(from) {
        Ok(mut source) => io::copy(&mut source, &mut File::create(to)?).map(drop),
        Err(e) if e.kind() == io::ErrorKind::NotFound => match fs::remove_file(to) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
            _ => Ok(()),
        },
        Err(e) => Err(e),
    }
}

/// A new directory that only this user can enter.
fn temporary_directory() -> Result<PrivateCopy> {
    let mut builder = DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    let mut number = 0;
    loop {
        let path = std::env::temp_dir().join(format!("iplw-{}-{number}", std::process::id()));
        match builder.create(&path) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => number += 1,
            Err(e) => return Err(Error::io(&path, e)),
            Ok(()) => return Ok(PrivateCopy(path)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Store;

    fn worlds(place: &DataDirectory, access: ReadAccess) -> i64 {
        let reader = open(place, access).unwrap();
        reader.connection.query_row("SELECT count(*) FROM world", [], |r| r.get(0)).unwrap()
    }

    fn names(directory: &Path) -> Vec<std::ffi::OsString> {
        let mut names: Vec<_> = fs::read_dir(directory).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        names
    }

    #[test]
    fn both_kinds_of_access_read_the_log_and_write_nothing() {
        let directory = tempfile::tempdir().unwrap();
        // Characters with a meaning in URIs.
        let path = directory.path().join("data?a=1#%20");
        let place = DataDirectory::at(&path);
        let store = Store::open(&path).unwrap();
        for i in 1..=2 {
            store.add_world(&format!("w{i}"), "{}", None, None).unwrap();
            for access in [ReadAccess::InPlace, ReadAccess::Copy] {
                assert_eq!(worlds(&place, access), i, "{access:?}, of a running server");
            }
        }
        drop(store);
        let before = names(&path);
        for access in [ReadAccess::InPlace, ReadAccess::Copy] {
            assert_eq!(worlds(&place, access), 2, "{access:?}");
        }
        assert_eq!(names(&path), before);
    }

    #[test]
    fn missing_permission_is_no_damage() {
        let denied = || io::Error::from(io::ErrorKind::PermissionDenied);
        let error = permissions::read_error(Path::new("iplw.sqlite"), denied());
        assert!(matches!(&error, Error::Refused { reason } if reason.contains("permission")), "{error}");
        let error = permissions::read_error(Path::new("iplw.sqlite"), io::Error::other("bad sector"));
        assert!(matches!(error, Error::Io { .. }));
    }
}
