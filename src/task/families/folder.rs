//! Reads families from a folder: each `*.toml` with the file of its certified tasks next to it.

use std::path::{Path, PathBuf};

use super::certificate::CertifiedTasks;
use super::family::Family;
use super::family_file::{MAX_FILE_BYTES, parse_beside};
use crate::error::{Error, Result};

/// Maximum size of a file of certified tasks, bytes: three times that of a thousand tasks of sixteen
/// components.
const MAX_CERTIFIED_BYTES: usize = 1 << 20;

/// Maximum size of a file of scenes, bytes.
const MAX_SCENES_BYTES: usize = 64 << 20;

/// Every family of a folder, in order of file name.
pub fn read_families(folder: &Path) -> Result<Vec<Family>> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let paths = entries.map(|e| e.map(|e| e.path()).map_err(|e| Error::io(folder, e)));
    let mut paths = paths.collect::<Result<Vec<PathBuf>>>()?;
    paths.retain(|p| p.extension().is_some_and(|e| e == "toml") && p.is_file());
    paths.sort();
    paths.iter().map(|path| read_certified(path)).collect()
}

/// A family without its certified tasks.
pub fn read_family(path: &Path) -> Result<Family> {
    let beside = |file: &str| text(&path.with_file_name(file), MAX_SCENES_BYTES);
    parse_beside(&text(path, MAX_FILE_BYTES)?, &beside).map_err(|e| e.in_file(path.display()))
}

/// Path of the certified tasks of a family's file: `NAME.certified.json` next to `NAME.toml`.
pub fn certified_beside(path: &Path) -> PathBuf {
    path.with_extension("certified.json")
}

fn read_certified(path: &Path) -> Result<Family> {
    let family = read_family(path)?;
    let beside = certified_beside(path);
    if !beside.is_file() {
        let value = format!("without {}", beside.display());
        let allowed =
            format!("certified tasks next to it; `iplw tasks check {}` creates them", path.display());
        return Err(Error::input("", value, allowed).in_file(path.display()));
    }
    let certified = CertifiedTasks::from_json(&text(&beside, MAX_CERTIFIED_BYTES)?);
    certified.and_then(|c| family.with_tasks(c)).map_err(|e| e.in_file(beside.display()))
}

fn text(path: &Path, most: usize) -> Result<String> {
    let size = std::fs::metadata(path).map_err(|e| Error::io(path, e))?.len();
    if size > most as u64 {
        let error = Error::input("", format!("{size} bytes"), format!("at most {most} bytes"));
        return Err(error.in_file(path.display()));
    }
    std::fs::read_to_string(path).map_err(|e| Error::io(path, e))
}
