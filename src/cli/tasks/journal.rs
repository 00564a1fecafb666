//! What a search for tasks has found, kept line by line so that one that was stopped goes on.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use iplw::reality::certify::{Judged, Search};
use iplw::task::Family;
use serde_json::{Value, json};

/// A file of JSON lines: what the search is of, then a candidate a line.
pub struct Journal {
    path: PathBuf,
    file: File,
}

impl Journal {
    /// Opens or begins the file; a search of the same takes over what is there. What was half written when it was stopped is
    /// looked at anew.
    pub fn open(
        path: &Path,
        family: &Family,
        seed: u64,
        wanted: usize,
        search: &mut Search,
    ) -> Result<Journal> {
        let of = json!({
            "format": "iplw.search/1", "version": env!("CARGO_PKG_VERSION"), "family": family.name,
            "digest": family.digest, "selection": family.selection, "seed": seed, "wanted": wanted,
        });
        let there = std::fs::read_to_string(path).unwrap_or_default();
        let mut lines = there.lines();
        let same = lines.next().and_then(|l| serde_json::from_str::<Value>(l).ok()) == Some(of.clone());
        if same {
            let found = lines.map_while(|line| serde_json::from_str::<Judged>(line).ok());
            for judged in found {
                if search.take(judged).is_err() {
                    break;
                }
            }
        }
        let kept = search.judged().iter().map(|j| json!(j).to_string() + "\n").collect::<String>();
        let failed = |e| Error::io(path, e);
        std::fs::write(path, format!("{of}\n{kept}")).map_err(failed)?;
        let file = OpenOptions::new().append(true).open(path).map_err(failed)?;
        if !search.judged().is_empty() {
            eprintln!("  goes on after {} candidates of {}", search.judged().len(), path.display());
        }
        Ok(Journal { path: path.into(), file })
    }

    /// Adds a candidate.
    pub fn add(&mut self, judged: &Judged) -> Result<()> {
        let line = json!(judged).to_string() + "\n";
        self.file.write_all(line.as_bytes()).map_err(|e| Error::io(&self.path, e))
    }

    /// All is found.
    pub fn remove(self) -> Result<()> {
        std::fs::remove_file(&self.path).map_err(|e| Error::io(&self.path, e))
    }
}
