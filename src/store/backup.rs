//! A copy of a data directory, made while a server may run on it, and the way back.
//!
//! A backup is a data directory of its own: the database by SQLite's `VACUUM INTO` as it was at one moment, the weights that it
//! names, and the tokens. It is looked at as `iplw check` does before it has its name, and again before it is restored.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use rusqlite::Connection;

use super::blobs::Blobs;
use super::check::{Checked, check, refuse};
use super::place::{Place, locked};
use super::sqlite::failed;
use super::whole::{synced, write_private};
use super::{private, schema};
use crate::error::{Error, Result};

/// How often a copy is begun anew because weights were replaced while it was made.
const MOST_TRIES: usize = 10;

/// Copies what is in the data directory `of` to the new directory `to`, all of it or nothing; says what the copy holds.
pub fn backup(of: &Path, to: &Path) -> Result<Checked> {
    let from = Place::at(of);
    from.there()?;
    if to.exists() && !empty(to) {
        let reason = format!("{} is there already; a backup takes a directory of its own", to.display());
        return Err(Error::Refused { reason });
    }
    let part = beside(to);
    let done = copied(&from, &part).and_then(|checked| {
        fs::rename(&part, to).map_err(|e| Error::io(to, e))?;
        sync(to.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")))?;
        Ok(checked)
    });
    if done.is_err() {
        let _ = fs::remove_dir_all(&part);
    }
    done
}

/// Puts what is in the backup `from` into the data directory `to`, all of it or nothing; says what it holds. Refuses to take
/// the place of what is there unless it is to `replace` it, and while a server has it open.
pub fn restore(from: &Path, to: &Path, replace: bool) -> Result<Checked> {
    let source = Place::at(from);
    source.there()?;
    private::own_directory(to)?;
    let place = Place::at(to);
    let same = |a: &Path, b: &Path| a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    if same(from, to) {
        return Err(Error::Refused { reason: format!("{} is the backup itself", to.display()) });
    }
    let _lock = locked(to)?;
    let taken = place.database.exists() || place.tokens.exists() || !empty(&place.policies);
    if (taken || place.restoring.exists()) && !replace {
        let reason = format!(
            "{} holds data already; give another directory, or --replace to have the backup in its place",
            to.display()
        );
        return Err(Error::Refused { reason });
    }
    let part = to.join("restored.part");
    let checked = copied(&source, &part).inspect_err(|_| drop(fs::remove_dir_all(&part)))?;
    write_private(&place.restoring, b"")?;
    exchange(&Place::at(&part), &place)?;
    sync(to)?;
    fs::remove_file(&place.restoring).map_err(|e| Error::io(&place.restoring, e))?;
    let _ = fs::remove_dir_all(&part);
    sync(to)?;
    Ok(checked)
}

/// Takes away what is there and moves in what comes. In the middle neither is whole, which the mark of the restore says.
fn exchange(comes: &Place, there: &Place) -> Result<()> {
    let log = |name: &str| PathBuf::from(format!("{}{name}", there.database.display()));
    for old in [there.database.clone(), log("-wal"), log("-shm"), log("-journal"), there.tokens.clone()] {
        match fs::remove_file(&old) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(Error::io(&old, e)),
            _ => {}
        }
    }
    if there.policies.exists() {
        fs::remove_dir_all(&there.policies).map_err(|e| Error::io(&there.policies, e))?;
    }
    for (new, name) in [
        (&comes.policies, &there.policies),
        (&comes.tokens, &there.tokens),
        (&comes.database, &there.database),
    ] {
        if new.exists() {
            fs::rename(new, name).map_err(|e| Error::io(name, e))?;
        }
    }
    Ok(())
}

/// A copy at `to`, whole and on the disk; in the place of one that was begun before.
fn copied(from: &Place, to: &Path) -> Result<Checked> {
    for _ in 0..MOST_TRIES {
        let _ = fs::remove_dir_all(to);
        private::make_directory(to)?;
        let copy = Place::at(to);
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
    Err(Error::Failed(format!("weights were replaced {MOST_TRIES} times while they were copied; try again")))
}

/// The database as it is at one moment.
fn snapshot(from: &Place, to: &Place) -> Result<()> {
    let name = from.database.display().to_string();
    let c = from.connect()?;
    schema::version(&c, &name)?;
    private::options().write(true).open(&to.database).map_err(|e| Error::io(&to.database, e))?;
    let Some(path) = to.database.to_str() else {
        return Err(Error::input("path", to.database.display(), "a path in UTF-8"));
    };
    c.execute("VACUUM INTO ?1", [path]).map(drop).map_err(|e| failed(&name, &e))
}

/// Copies the weights that the copied database names; whether all of them were there: a server may have replaced some since.
fn weights(from: &Place, to: &Place) -> Result<bool> {
    private::make_directory(&to.policies)?;
    let name = to.database.display().to_string();
    let named = |c: Connection| -> rusqlite::Result<Vec<String>> {
        let mut query = c.prepare("SELECT blob FROM policy")?;
        query.query_map([], |r| r.get(0))?.collect()
    };
    let copies = Blobs::Directory(to.policies.clone());
    for blob in named(to.connect()?).map_err(|e| failed(&name, &e))? {
        let path = from.policies.join(&blob);
        match fs::read(&path) {
            Ok(bytes) => copies.write(&blob, &bytes)?,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return still_named(from, &blob),
            Err(e) => return Err(Error::io(&path, e)),
        }
    }
    Ok(true)
}

/// Errors if weights that are gone are not gone because something took their place.
fn still_named(from: &Place, blob: &str) -> Result<bool> {
    let name = from.database.display().to_string();
    let select = "SELECT count(*) FROM policy WHERE blob = ?1";
    let named: i64 =
        from.connect()?.query_row(select, [blob], |r| r.get(0)).map_err(|e| failed(&name, &e))?;
    if named == 0 {
        return Ok(false);
    }
    Err(Error::Damaged { what: format!("weights {blob}"), how: "the file is gone".into() })
}

/// Where a copy is made until it is whole.
fn beside(to: &Path) -> PathBuf {
    let name = to.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    to.with_file_name(format!(".{name}.{}.part", std::process::id()))
}

/// Whether there is nothing in a directory, or no such directory.
fn empty(directory: &Path) -> bool {
    match fs::read_dir(directory) {
        Ok(mut entries) => entries.next().is_none(),
        Err(e) => e.kind() == std::io::ErrorKind::NotFound,
    }
}

/// Waits until a file or a directory is on the disk.
fn sync(path: &Path) -> Result<()> {
    let done = if path.is_dir() { synced(path) } else { File::open(path).and_then(|f| f.sync_all()) };
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
    fn a_backup_is_of_one_moment_and_comes_back_only_where_it_may() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        let store = filled(&at("data"), "w1");
        fs::write(at("data").join("tokens.json"), "{}").unwrap();
        assert_eq!(backup(&at("data"), &at("kept")).unwrap().rows["world"], 1, "while it is open");
        store.add_world("w2", "{}", None, None).unwrap();
        store.put_policy(&named("a"), &[9, 9, 9], None).unwrap();
        let again = backup(&at("data"), &at("kept")).unwrap_err().to_string();
        assert!(again.contains("there already"), "{again}");
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
    fn what_is_damaged_is_not_backed_up_and_not_restored() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        drop(filled(&at("data"), "w1"));
        backup(&at("data"), &at("kept")).unwrap();
        for there in ["data", "kept"] {
            fs::write(at(there).join("policies/a.1.safetensors"), [1, 2, 4]).unwrap();
        }
        let damaged = |done: Result<Checked>| matches!(done, Err(Error::Damaged { what, .. }) if what.contains("policy a"));
        assert!(damaged(backup(&at("data"), &at("other"))));
        assert!(damaged(restore(&at("kept"), &at("data"), true)));
        assert!(!at("other").exists() && fs::read_dir(place.path()).unwrap().count() == 2, "nothing is left");
        assert_eq!(worlds(&Store::open(&at("data")).unwrap()), ["w1"]);
    }

    #[test]
    fn a_restore_that_was_cut_off_is_told_of_until_it_is_done_again() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        drop(filled(&at("data"), "w1"));
        backup(&at("data"), &at("kept")).unwrap();
        fs::write(at("data").join("restoring"), "").unwrap();
        fs::remove_file(at("data").join("iplw.sqlite")).unwrap();
        let told = Store::open(&at("data")).err().unwrap().to_string();
        assert!(told.contains("restore") && told.contains("--replace"), "{told}");
        restore(&at("kept"), &at("data"), true).unwrap();
        assert_eq!(worlds(&Store::open(&at("data")).unwrap()), ["w1"]);
    }

    /// Weights that are replaced all the while are those of the row that was copied, or the copy is made again.
    #[test]
    fn a_backup_of_a_busy_store_is_whole() {
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
                let kept = place.path().join(format!("kept{i}"));
                let held = backup(&data, &kept).unwrap();
                let copy = Store::open(&kept).unwrap();
                let names = worlds(&copy);
                assert_eq!(names.len() as u64, held.rows["world"]);
                assert!(names.iter().enumerate().all(|(i, name)| *name == format!("w{i}")), "of one moment");
                assert_eq!(copy.weights("a").unwrap().unwrap().len(), 3);
            }
            stop.store(true, order);
        });
    }
}
