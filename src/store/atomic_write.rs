//! Atomic file writes.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::{layout, permissions};
use crate::error::{Error, Result};

/// Writes a file atomically by a temporary file and a rename: readers see the old or the new contents. File and directory are
/// synced before it returns. A symbolic link is replaced, not its target.
///
/// A path that is not a regular file (a device such as `/dev/null`, a pipe) is written directly, since a rename would replace
/// it.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    match fs::metadata(path) {
        Ok(there) if !there.is_file() && !there.is_dir() => {
            let opened = OpenOptions::new().write(true).open(path);
            opened.and_then(|mut sink| sink.write_all(bytes)).map_err(|e| Error::io(path, e))
        }
        _ => write_atomically(path, bytes, &mut OpenOptions::new(), sync_directory),
    }
}

/// [`write_whole`] for files that only their owner can read.
pub fn write_private(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically(path, bytes, &mut permissions::options(), sync_directory)
}

/// Size of the file of [`probe_write`], bytes.
const PROBE_BYTES: usize = 64 << 10;

/// Errors unless the directory takes a durable write now.
pub fn probe_write(directory: &Path) -> Result<()> {
    let (part, mut file) = create_part(&directory.join(layout::PROBE), &mut permissions::options())?;
    let done = file.write_all(&[0; PROBE_BYTES]).and_then(|()| file.sync_all());
    done.and(fs::remove_file(&part)).map_err(|e| {
        let _ = fs::remove_file(&part);
        Error::io(directory, e)
    })
}

/// Renames a complete file to its final name and syncs both.
pub fn rename_into_place(part: &Path, path: &Path) -> Result<()> {
    let directory = path.parent().unwrap_or(Path::new("."));
    let done = File::open(part)
        .and_then(|file| file.sync_all())
        .and_then(|()| fs::rename(part, path))
        .and_then(|()| sync_directory(directory));
    done.map_err(|e| Error::io(path, e))
}

fn write_atomically(
    path: &Path,
    bytes: &[u8],
    options: &mut OpenOptions,
    sync: impl Fn(&Path) -> io::Result<()>,
) -> Result<()> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    fs::create_dir_all(directory).map_err(|e| Error::io(directory, e))?;
    let (part, mut file) = create_part(path, options)?;
    let done = file
        .write_all(bytes)
        .and_then(|()| file.sync_all())
        .and_then(|()| fs::rename(&part, path))
        .and_then(|()| sync(directory));
    done.map_err(|e| {
        let _ = fs::remove_file(&part);
        Error::io(path, e)
    })
}

/// Creates a temporary file next to `path`. Existing files, and the targets of existing links, are not opened: they belong to
/// another write.
fn create_part(path: &Path, options: &mut OpenOptions) -> Result<(PathBuf, File)> {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let mut number = 0;
    loop {
        let part = path.with_file_name(layout::temporary_name(&name, number));
        match options.write(true).create_new(true).open(&part) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => number += 1,
            Err(e) => return Err(Error::io(path, e)),
            Ok(file) => return Ok((part, file)),
        }
    }
}

/// Syncs a directory.
#[cfg(unix)]
pub fn sync_directory(directory: &Path) -> io::Result<()> {
    File::open(directory)?.sync_all()
}

/// Directories cannot be opened on this platform, and renames are durable.
#[cfg(not(unix))]
pub fn sync_directory(_: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;

    #[test]
    fn atomic_write_syncs_directory() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("new").join("file");
        let synced_files = RefCell::new(Vec::new());
        let sync = |directory: &Path| {
            synced_files.borrow_mut().push((directory.to_path_buf(), fs::read(&path)?));
            sync_directory(directory)
        };
        write_atomically(&path, b"whole", &mut OpenOptions::new(), sync).unwrap();
        assert_eq!(
            *synced_files.borrow(),
            [(place.path().join("new"), b"whole".to_vec())],
            "once it has its name"
        );
        write_whole(&path, b"newer").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"newer");
        assert_eq!(fs::read_dir(place.path().join("new")).unwrap().count(), 1, "nothing is left beside it");
    }

    #[cfg(unix)]
    #[test]
    fn writes_to_pipe_directly() {
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
    fn failed_write_leaves_no_file() {
        let place = tempfile::tempdir().unwrap();
        fs::create_dir(place.path().join("taken")).unwrap();
        assert!(write_whole(&place.path().join("taken"), b"x").is_err());
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn targets_of_links_are_not_written() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        fs::write(at("target"), "old").unwrap();
        for link in ["file", &layout::temporary_name("file", 0)] {
            std::os::unix::fs::symlink(at("target"), at(link)).unwrap();
        }
        write_private(&at("file"), b"new").unwrap();
        assert_eq!(
            (fs::read(at("file")).unwrap(), fs::read(at("target")).unwrap()),
            (b"new".into(), b"old".into())
        );
        assert!(!at("file").is_symlink());
    }

    #[test]
    fn probe_leaves_no_file_and_reports_failure() {
        let place = tempfile::tempdir().unwrap();
        probe_write(place.path()).unwrap();
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 0);
        assert!(probe_write(&place.path().join("missing")).is_err());
    }
}
