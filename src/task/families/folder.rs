//! Families of a folder: each `*.toml` with the file of its certified tasks beside it.

use std::path::{Path, PathBuf};

use super::certified::Certified;
use super::family::Family;
use super::file::{MOST_BYTES, parse_beside};
use crate::error::{Error, Result};

/// Most bytes of a file of certified tasks: a thousand tasks of sixteen components are a third of it.
const MOST_CERTIFIED: usize = 1 << 20;

/// Most bytes of a file of scenes.
const MOST_SCENES: usize = 64 << 20;

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
    let beside = |file: &str| text(&path.with_file_name(file), MOST_SCENES);
    parse_beside(&text(path, MOST_BYTES)?, &beside).map_err(|e| e.at(path.display()))
}

/// Where the certified tasks of a family's file are: `NAME.certified.json` beside `NAME.toml`.
pub fn certified_beside(path: &Path) -> PathBuf {
    path.with_extension("certified.json")
}

fn read_certified(path: &Path) -> Result<Family> {
    let family = read_family(path)?;
    let beside = certified_beside(path);
    if !beside.is_file() {
        let value = format!("without {}", beside.display());
        let allowed = format!("certified tasks beside it: `iplw tasks check {}` makes them", path.display());
        return Err(Error::input("", value, allowed).at(path.display()));
    }
    let certified = Certified::from_json(&text(&beside, MOST_CERTIFIED)?);
    certified.and_then(|c| family.with(c)).map_err(|e| e.at(beside.display()))
}

fn text(path: &Path, most: usize) -> Result<String> {
    let size = std::fs::metadata(path).map_err(|e| Error::io(path, e))?.len();
    if size > most as u64 {
        let error = Error::input("", format!("{size} bytes"), format!("at most {most} bytes"));
        return Err(error.at(path.display()));
    }
    std::fs::read_to_string(path).map_err(|e| Error::io(path, e))
}
