//! Files and directories that only their owner can read.

use std::fs::{self, OpenOptions};
use std::path::Path;

use crate::error::{Error, Result};

/// Names that belong to a data directory.
const OWN_ENTRIES: [&str; 6] = ["iplw.sqlite", "policies", "tokens.", "lock", "restoring", "restored.part"];

/// Creates a private directory if it is missing; its parents get the default permissions.
pub fn make_directory(path: &Path) -> Result<()> {
    if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        fs::create_dir_all(parent).map_err(|e| Error::io(parent, e))?;
    }
    let mut builder = fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    match builder.create(path) {
        Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists && path.is_dir() => Ok(()),
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
    let ours = |name: &str| OWN_ENTRIES.iter().any(|o| name.trim_start_matches('.').starts_with(o));
    let names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
    let all_ours = names.iter().all(|name| name.to_str().is_some_and(ours));
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
    restrict(&directory.join("policies"), 0o700);
    for folder in [directory.to_path_buf(), directory.join("policies")] {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let named = entry
                .file_name()
                .to_str()
                .is_some_and(|name| OWN_ENTRIES.iter().any(|o| name.starts_with(o)));
            let blob = entry.path().parent().is_some_and(|p| p != directory);
            if (named || blob) && entry.file_type().is_ok_and(|t| t.is_file()) {
                restrict(&entry.path(), 0o600);
            }
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
