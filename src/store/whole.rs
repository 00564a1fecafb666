//! Files written whole or not at all.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

use crate::error::{Error, Result};

/// Writes a file by way of a temporary one beside it, so that a reader sees the old or the new, never a half. Both the
/// file and its directory are on the disk when this returns: a name that is known to hold the new file keeps it.
///
/// What stands there and is no file (a device such as `/dev/null`, a pipe) is written to as it is: a rename would put a
/// file in its place.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    match fs::metadata(path) {
        Ok(there) if !there.is_file() && !there.is_dir() => {
            let opened = fs::OpenOptions::new().write(true).open(path);
            opened.and_then(|mut sink| sink.write_all(bytes)).map_err(|e| Error::io(path, e))
        }
        _ => written(path, bytes, &|p| File::create(p), synced),
    }
}

/// [`write_whole`] for what only its owner may read.
pub fn write_private(path: &Path, bytes: &[u8]) -> Result<()> {
    written(path, bytes, &private, synced)
}

fn private(path: &Path) -> io::Result<File> {
    super::private::options().write(true).truncate(true).open(path)
}

/// Gives a file that is written its name: on the disk, both, when this returns.
pub fn named(part: &Path, path: &Path) -> Result<()> {
    let directory = path.parent().unwrap_or(Path::new("."));
    let done = File::open(part)
        .and_then(|file| file.sync_all())
        .and_then(|()| fs::rename(part, path))
        .and_then(|()| synced(directory));
    done.map_err(|e| Error::io(path, e))
}

fn written(
    path: &Path,
    bytes: &[u8],
    create: &dyn Fn(&Path) -> io::Result<File>,
    sync: impl Fn(&Path) -> io::Result<()>,
) -> Result<()> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    fs::create_dir_all(directory).map_err(|e| Error::io(directory, e))?;
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let part = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let done = create(&part)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| fs::rename(&part, path))
        .and_then(|()| sync(directory));
    done.map_err(|e| {
        let _ = fs::remove_file(&part);
        Error::io(path, e)
    })
}

/// Waits until what the directory says of its files is on the disk.
#[cfg(unix)]
pub fn synced(directory: &Path) -> io::Result<()> {
    File::open(directory)?.sync_all()
}

/// A directory cannot be opened, and renaming lasts by itself.
#[cfg(not(unix))]
pub fn synced(_: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;

    #[test]
    fn a_file_written_whole_has_its_directory_synced() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("new").join("file");
        let seen = RefCell::new(Vec::new());
        let sync = |directory: &Path| {
            seen.borrow_mut().push((directory.to_path_buf(), fs::read(&path)?));
            synced(directory)
        };
        written(&path, b"whole", &|p| File::create(p), sync).unwrap();
        assert_eq!(*seen.borrow(), [(place.path().join("new"), b"whole".to_vec())], "once it has its name");
        write_whole(&path, b"newer").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"newer");
        assert_eq!(fs::read_dir(place.path().join("new")).unwrap().count(), 1, "nothing is left beside it");
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_file_is_written_to_and_stays() {
        let place = tempfile::tempdir().unwrap();
        let pipe = place.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).unwrap()
        });
        write_whole(&pipe, b"whole").unwrap();
        assert_eq!(reader.join().unwrap(), b"whole");
        assert!(!fs::metadata(&pipe).unwrap().is_file(), "the pipe is still a pipe");
    }

    #[test]
    fn what_cannot_be_written_leaves_nothing() {
        let place = tempfile::tempdir().unwrap();
        fs::create_dir(place.path().join("taken")).unwrap();
        assert!(write_whole(&place.path().join("taken"), b"x").is_err());
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1);
    }
}
