//! Backup of a data directory, while a server may run on it, and restore.
//!
//! A backup is a data directory: a snapshot of the database by SQLite's `VACUUM INTO`, the weights it refers to, and the tokens. It
//! is checked as by `iplw check` before it gets its name, and again before it is restored.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use super::atomic_write::{sync_directory, write_private};
use super::blobs::Blobs;
use super::check::{CheckReport, check, refuse};
use super::data_directory::{DataDirectory, lock_directory, refuse_foreign_files};
use super::sqlite::{failed, query};
use super::{layout, permissions, schema};
use crate::error::{Error, Result};

/// Maximum attempts to copy if weights are replaced meanwhile.
const MAX_COPY_ATTEMPTS: usize = 10;

/// Copies the data directory `of` to the new directory `to`, atomically; returns the check of the copy.
pub fn backup(of: &Path, to: &Path) -> Result<CheckReport> {
    let from = DataDirectory::at(of);
    from.check_exists()?;
    if to.exists() && !is_empty_directory(to) {
        let reason = format!("{} already exists; choose a new directory for the backup", to.display());
        return Err(Error::Refused { reason });
    }
    let part = temporary_path(to);
    let done = copy_to(&from, &part).and_then(|checked| {
        fs::rename(&part, to).map_err(|e| Error::io(to, e))?;
        sync(to.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")))?;
        Ok(checked)
    });
    if done.is_err() {
        let _ = fs::remove_dir_all(&part);
    }
    done
}

/// Restores the backup `from` into the data directory `to`, atomically; returns the check of the copy. Refuses to overwrite data
/// without `replace`, and while a server has the directory open.
pub fn restore(from: &Path, to: &Path, replace: bool) -> Result<CheckReport> {
    let source = DataDirectory::at(from);
    source.check_exists()?;
    refuse_foreign_files(to)?;
    permissions::secure_data_directory(to)?;
    let place = DataDirectory::at(to);
    let same = |a: &Path, b: &Path| a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    if same(from, to) {
        return Err(Error::Refused { reason: format!("{} is the backup itself", to.display()) });
    }
    let _lock = lock_directory(to)?;
    let has_data = place.database.exists() || place.tokens.exists() || !is_empty_directory(&place.policies);
    if (has_data || place.restoring.exists()) && !replace {
        let reason = format!(
            "{} already holds data; choose another directory, or --replace to overwrite it",
            to.display()
        );
        return Err(Error::Refused { reason });
    }
    let part = to.join(layout::RESTORED);
    let checked = copy_to(&source, &part).inspect_err(|_| drop(fs::remove_dir_all(&part)))?;
    write_private(&place.restoring, b"")?;
    replace_contents(&DataDirectory::at(&part), &place)?;
    sync(to)?;
    fs::remove_file(&place.restoring).map_err(|e| Error::io(&place.restoring, e))?;
    let _ = fs::remove_dir_all(&part);
    sync(to)?;
    Ok(checked)
}

/// Replaces the contents; files of others among the weights stay. Until it is complete neither is whole; the marker file
/// `restoring` records that.
fn replace_contents(comes: &DataDirectory, there: &DataDirectory) -> Result<()> {
    let of_database = ["", "-wal", "-shm", "-journal"].map(|ending| there.companion(ending));
    for old in of_database.into_iter().chain([there.tokens.clone()]) {
        match fs::remove_file(&old) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(Error::io(&old, e)),
            _ => {}
        }
    }
    Blobs::directory(&there.policies)?.retain(|_| false)?;
    let weights = fs::read_dir(&comes.policies).map_err(|e| Error::io(&comes.policies, e))?;
    for entry in weights {
        let entry = entry.map_err(|e| Error::io(&comes.policies, e))?;
        let path = there.policies.join(entry.file_name());
        fs::rename(entry.path(), &path).map_err(|e| Error::io(&path, e))?;
    }
    sync(&there.policies)?;
    for (new, name) in [(&comes.tokens, &there.tokens), (&comes.database, &there.database)] {
        if new.exists() {
            fs::rename(new, name).map_err(|e| Error::io(name, e))?;
        }
    }
    Ok(())
}

/// Makes a complete, synced copy at `to`, replacing an unfinished one.
fn copy_to(from: &DataDirectory, to: &Path) -> Result<CheckReport> {
    refuse_foreign_files(to)?;
    for _ in 0..MAX_COPY_ATTEMPTS {
        let _ = fs::remove_dir_all(to);
        permissions::make_directory(to)?;
        let copy = DataDirectory::at(to);
        snapshot(from, &copy)?;
        if !weights(from, &copy)? {
            continue;
        }
        if from.tokens.exists() {
            let tokens = fs::read(&from.tokens).map_err(|e| Error::io(&from.tokens, e))?;
            write_private(&copy.tokens, &tokens)?;
        }
        let checked = check(to)?;
        refuse(&checked.damaged)?;
        for left in ["-wal", "-shm"] {
            let _ = fs::remove_file(format!("{}{left}", copy.database.display()));
        }
        sync(&copy.database)?;
        sync(to)?;
        return Ok(checked);
    }
    Err(Error::Failed(format!("weights were replaced {MAX_COPY_ATTEMPTS} times during the copy; try again")))
}

/// Snapshot of the database.
fn snapshot(from: &DataDirectory, to: &DataDirectory) -> Result<()> {
    let name = from.database.display().to_string();
    let c = from.connect()?;
    schema::version(&c, &name)?;
    permissions::options().write(true).open(&to.database).map_err(|e| Error::io(&to.database, e))?;
    let Some(path) = to.database.to_str() else {
        return Err(Error::input("path", to.database.display(), "a path in UTF-8"));
    };
    c.execute("VACUUM INTO ?1", [path]).map(drop).map_err(|e| failed(&name, &e))
}

/// Copies the weights that the copied database refers to; false if some were replaced by the server meanwhile.
fn weights(from: &DataDirectory, to: &DataDirectory) -> Result<bool> {
    permissions::make_directory(&to.policies)?;
    let name = to.database.display().to_string();
    let blobs: Vec<String> =
        query(&to.connect()?, "SELECT blob FROM policy", [], |r| r.get(0)).map_err(|e| failed(&name, &e))?;
    let copies = Blobs::Directory(to.policies.clone());
    for blob in blobs {
        let path = from.policies.join(&blob);
        match fs::read(&path) {
            Ok(bytes) => copies.write(&blob, &bytes)?,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return check_weights_replaced(from, &blob),
            Err(e) => return Err(Error::io(&path, e)),
        }
    }
    Ok(true)
}

/// Errors if missing weights were not replaced by newer ones.
fn check_weights_replaced(from: &DataDirectory, blob: &str) -> Result<bool> {
    let name = from.database.display().to_string();
    let select = "SELECT count(*) FROM policy WHERE blob = ?1";
    let named: i64 =
        from.connect()?.query_row(select, [blob], |r| r.get(0)).map_err(|e| failed(&name, &e))?;
    if named == 0 {
        return Ok(false);
    }
    Err(Error::Damaged { what: format!("weights {blob}"), how: "the file is missing".into() })
}

/// Temporary path of an unfinished copy.
fn temporary_path(to: &Path) -> PathBuf {
    let name = to.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    to.with_file_name(format!(".{name}.{}.part", std::process::id()))
}

/// Whether a directory is empty or missing.
fn is_empty_directory(directory: &Path) -> bool {
    match fs::read_dir(directory) {
        Ok(mut entries) => entries.next().is_none(),
        Err(e) => e.kind() == std::io::ErrorKind::NotFound,
    }
}

/// Syncs a file or a directory to disk.
fn sync(path: &Path) -> Result<()> {
    let done = if path.is_dir() { sync_directory(path) } else { File::open(path).and_then(|f| f.sync_all()) };
    done.map_err(|e| Error::io(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Store;
    use crate::store::policies::tests::named;

    fn filled(directory: &Path, world: &str) -> Store {
        let store = Store::open(directory).unwrap();
        store.add_world(world, "{}", None, None).unwrap();
        store.put_policy(&named("a"), &[1, 2, 3], None).unwrap();
        store
    }

    fn worlds(store: &Store) -> Vec<String> {
        store.worlds().unwrap().into_iter().map(|w| w.id).collect()
    }

    #[test]
    fn backup_is_a_snapshot_and_restore_needs_replace() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        let store = filled(&at("data"), "w1");
        fs::write(at("data").join("tokens.json"), "{}").unwrap();
        assert_eq!(backup(&at("data"), &at("kept")).unwrap().rows["world"], 1, "while it is open");
        store.add_world("w2", "{}", None, None).unwrap();
        store.put_policy(&named("a"), &[9, 9, 9], None).unwrap();
        let again = backup(&at("data"), &at("kept")).unwrap_err().to_string();
        assert!(again.contains("already exists"), "{again}");
        let open = restore(&at("kept"), &at("data"), true).unwrap_err().to_string();
        assert!(open.contains("in use"), "{open}");
        drop(store);
        let refused = restore(&at("kept"), &at("data"), false).unwrap_err().to_string();
        assert!(refused.contains("--replace"), "{refused}");
        assert_eq!(worlds(&Store::open(&at("data")).unwrap()), ["w1", "w2"], "nothing was touched");
        restore(&at("kept"), &at("data"), true).unwrap();
        restore(&at("kept"), &at("elsewhere"), false).unwrap();
        for there in ["data", "elsewhere"] {
            let store = Store::open(&at(there)).unwrap();
            assert_eq!(worlds(&store), ["w1"]);
            assert_eq!(store.weights("a").unwrap().unwrap(), [1, 2, 3]);
            assert_eq!(fs::read_to_string(at(there).join("tokens.json")).unwrap(), "{}");
            assert_eq!(check(&at(there)).unwrap().damaged, []);
        }
        assert!(restore(&at("kept"), &at("kept"), true).is_err());
        assert!(!at("data").join("restored.part").exists() && !at("data").join("restoring").exists());
    }

    #[test]
    fn refuses_to_copy_damaged_data() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        drop(filled(&at("data"), "w1"));
        backup(&at("data"), &at("kept")).unwrap();
        for there in ["data", "kept"] {
            fs::write(at(there).join("policies/a.1.safetensors"), [1, 2, 4]).unwrap();
        }
        let damaged = |done: Result<CheckReport>| matches!(done, Err(Error::Damaged { what, .. }) if what.contains("policy a"));
        assert!(damaged(backup(&at("data"), &at("other"))));
        assert!(damaged(restore(&at("kept"), &at("data"), true)));
        assert!(!at("other").exists() && fs::read_dir(place.path()).unwrap().count() == 2, "nothing is left");
        assert_eq!(worlds(&Store::open(&at("data")).unwrap()), ["w1"]);
    }

    #[test]
    fn reports_interrupted_restore() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        drop(filled(&at("data"), "w1"));
        backup(&at("data"), &at("kept")).unwrap();
        fs::write(at("data").join("restoring"), "").unwrap();
        fs::remove_file(at("data").join("iplw.sqlite")).unwrap();
        let error = Store::open(&at("data")).err().unwrap().to_string();
        assert!(error.contains("restore") && error.contains("--replace"), "{error}");
        restore(&at("kept"), &at("data"), true).unwrap();
        assert_eq!(worlds(&Store::open(&at("data")).unwrap()), ["w1"]);
    }

    /// Weights that are replaced concurrently match the copied row, or the copy is repeated.
    #[test]
    fn backup_of_busy_store_is_consistent() {
        let place = tempfile::tempdir().unwrap();
        let data = place.path().join("data");
        let store = filled(&data, "w0");
        let stop = std::sync::atomic::AtomicBool::new(false);
        let order = std::sync::atomic::Ordering::SeqCst;
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for i in 1.. {
                    store.add_world(&format!("w{i}"), "{}", None, None).unwrap();
                    if i % 8 == 0 {
                        store.put_policy(&named("a"), &[i as u8; 3], None).unwrap();
                    }
                    if stop.load(order) {
                        break;
                    }
                }
            });
            for i in 0..5 {
                let copy_path = place.path().join(format!("kept{i}"));
                let held = backup(&data, &copy_path).unwrap();
                let copy = Store::open(&copy_path).unwrap();
                let names = worlds(&copy);
                assert_eq!(names.len() as u64, held.rows["world"]);
                assert!(names.iter().enumerate().all(|(i, name)| *name == format!("w{i}")), "of one moment");
                assert_eq!(copy.weights("a").unwrap().unwrap().len(), 3);
            }
            stop.store(true, order);
        });
    }
}
