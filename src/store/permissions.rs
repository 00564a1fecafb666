//! Files and directories that only their owner can read.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::Path;

use super::layout;
use crate::error::{Error, Result};

/// Creates a private directory if it is missing; its parents get the default permissions.
pub fn make_directory(path: &Path) -> Result<()> {
    if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        fs::create_dir_all(parent).map_err(|e| Error::io(parent, e))?;
    }
    let mut builder = fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    match builder.create(path) {
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists && path.is_dir() => Ok(()),
        done => done.map_err(|e| Error::io(path, e)),
    }
}

/// Creates a private data directory. An existing one is made private if it holds nothing else; otherwise a warning is logged,
/// because the other files may be shared on purpose.
pub fn secure_data_directory(path: &Path) -> Result<()> {
    make_directory(path)?;
    if !open_to_others(path) {
        return Ok(());
    }
    let entries = fs::read_dir(path).map_err(|e| Error::io(path, e))?;
    let names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
    let all_ours = names.iter().all(|name| name.to_str().is_some_and(layout::is_own_name));
    if all_ours && restrict(path, 0o700) {
        if !names.is_empty() {
            tracing::warn!(
                "{}: this data directory was readable by others; it is private now",
                path.display()
            );
        }
    } else {
        tracing::warn!(
            "{}: others can list this data directory, because it contains other files or belongs to another user; \
             `chmod 700` it, or use a separate directory. The server's own files are private",
            path.display()
        );
    }
    Ok(())
}

/// Makes the files of a data directory private; earlier versions did not.
pub fn restrict_files(directory: &Path) {
    let policies = directory.join(layout::POLICIES);
    if fs::symlink_metadata(&policies).is_ok_and(|m| m.is_dir()) {
        restrict(&policies, 0o700);
    }
    restrict_named(directory, layout::is_own_name);
    restrict_named(&policies, layout::is_blob_name);
}

/// Makes the regular files whose name is one of the program's private.
fn restrict_named(folder: &Path, is_own: fn(&str) -> bool) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let named = entry.file_name().to_str().is_some_and(is_own);
        if named && entry.file_type().is_ok_and(|t| t.is_file()) {
            restrict(&entry.path(), 0o600);
        }
    }
}

/// Options to open or create a private file.
pub fn options() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.create(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
}

/// Opens or creates a private file to be locked. Its content is not changed; a symbolic link is refused, since its target may
/// belong to somebody else.
pub fn open_lock_file(path: &Path) -> Result<File> {
    let mut options = options();
    options.read(true).write(true).truncate(false);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NOFOLLOW);
    // FILE_FLAG_OPEN_REPARSE_POINT.
    #[cfg(windows)]
    std::os::windows::fs::OpenOptionsExt::custom_flags(&mut options, 0x0020_0000);
    options.open(path).map_err(|e| {
        if !path.is_symlink() {
            return Error::io(path, e);
        }
        Error::Refused { reason: format!("{} is a symbolic link; remove it", path.display()) }
    })
}

/// The error of a file that cannot be read: a missing permission is no damage.
pub fn read_error(path: &Path, error: io::Error) -> Error {
    if error.kind() != io::ErrorKind::PermissionDenied {
        return Error::io(path, error);
    }
    let reason = format!(
        "{}: no permission to read this file; run the command as its owner or as an administrator",
        path.display()
    );
    Error::Refused { reason }
}

#[cfg(unix)]
fn open_to_others(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    fs::metadata(path).is_ok_and(|m| m.permissions().mode() & 0o077 != 0)
}

/// Sets the mode; whether the path is private afterwards.
#[cfg(unix)]
fn restrict(path: &Path, mode: u32) -> bool {
    use std::os::unix::fs::PermissionsExt;
    if open_to_others(path)
        && let Err(e) = fs::set_permissions(path, fs::Permissions::from_mode(mode))
    {
        tracing::warn!("{}: it is readable by others and its mode cannot be changed: {e}", path.display());
    }
    !open_to_others(path)
}

/// Permissions are left to the parent directory on this platform.
#[cfg(not(unix))]
fn open_to_others(_: &Path) -> bool {
    false
}

#[cfg(not(unix))]
fn restrict(_: &Path, _: u32) -> bool {
    true
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use std::collections::BTreeMap;
    use std::os::unix::fs::PermissionsExt;
    use std::path::PathBuf;

    use super::*;
    use crate::store::Store;
    use crate::store::policies::tests::named;

    fn modes(directory: &Path) -> BTreeMap<PathBuf, u32> {
        let mut all = BTreeMap::new();
        let mut pending = vec![directory.to_path_buf()];
        while let Some(path) = pending.pop() {
            all.insert(path.clone(), fs::metadata(&path).unwrap().permissions().mode() & 0o7777);
            if path.is_dir() {
                pending.extend(fs::read_dir(&path).unwrap().map(|e| e.unwrap().path()));
            }
        }
        all
    }

    fn assert_private(directory: &Path) {
        for (path, mode) in modes(directory) {
            let expected = if path.is_dir() { 0o700 } else { 0o600 };
            assert_eq!(mode, expected, "{}", path.display());
        }
    }

    #[test]
    fn data_directory_is_private() {
        let place = tempfile::tempdir().unwrap();
        let directory = place.path().join("new").join("data");
        for _ in 0..2 {
            let store = Store::open(&directory).unwrap();
            store.put_policy(&named("a"), &[1, 2, 3], None).unwrap();
            store.add_world(&format!("w{}", store.worlds().unwrap().len()), "{}", None, None).unwrap();
            assert!(directory.join("iplw.sqlite-wal").exists(), "it is looked at while it is written");
            assert_private(&directory);
            drop(store);
            assert_private(&directory);
            // As earlier versions created it.
            for path in modes(&directory).into_keys() {
                let mode = if path.is_dir() { 0o755 } else { 0o644 };
                fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
            }
        }
    }

    #[test]
    fn keeps_mode_of_shared_directory() {
        let place = tempfile::tempdir().unwrap();
        drop(Store::open(place.path()).unwrap());
        fs::set_permissions(place.path(), fs::Permissions::from_mode(0o755)).unwrap();
        let other = place.path().join("others.txt");
        fs::write(&other, "theirs").unwrap();
        fs::set_permissions(&other, fs::Permissions::from_mode(0o644)).unwrap();
        drop(Store::open(place.path()).unwrap());
        let modes = modes(place.path());
        assert_eq!((modes[place.path()], modes[&other]), (0o755, 0o644));
        assert_eq!(modes[&place.path().join("iplw.sqlite")], 0o600);
    }
}
