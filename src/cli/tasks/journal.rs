//! Journal of a task search, from which an interrupted search resumes.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use iplw::reality::certify::{CandidateResult, CertificationSearch};
use iplw::task::Family;
use serde_json::{Value, json};

use crate::cli::output;

/// A JSON Lines file: a header that identifies the search, then one line for each candidate.
pub struct Journal {
    path: PathBuf,
    file: File,
}

impl Journal {
    /// Opens or creates the file; results of the same search are loaded. A partially written line is dropped.
    pub fn open(
        path: &Path,
        family: &Family,
        seed: u64,
        wanted: usize,
        search: &mut CertificationSearch,
    ) -> Result<Journal> {
        let header = json!({
            "format": "iplw.search/1", "version": env!("CARGO_PKG_VERSION"), "family": family.name,
            "digest": family.digest, "selection": family.selection, "seed": seed, "wanted": wanted,
        });
        let existing = std::fs::read_to_string(path).unwrap_or_default();
        let mut lines = existing.lines();
        let same = lines.next().and_then(|l| serde_json::from_str::<Value>(l).ok()) == Some(header.clone());
        if same {
            let found = lines.map_while(|line| serde_json::from_str::<CandidateResult>(line).ok());
            for judged in found {
                if search.resume_with(judged).is_err() {
                    break;
                }
            }
        }
        let lines_kept = search.results().iter().map(|j| json!(j).to_string() + "\n").collect::<String>();
        let failed = |e| Error::io(path, e);
        output::write_whole(path, format!("{header}\n{lines_kept}").as_bytes())?;
        let file = OpenOptions::new().append(true).open(path).map_err(failed)?;
        if !search.results().is_empty() {
            eprintln!("  resumes after {} candidates of {}", search.results().len(), path.display());
        }
        Ok(Journal { path: path.into(), file })
    }

    /// Adds a candidate.
    pub fn add(&mut self, judged: &CandidateResult) -> Result<()> {
        let line = json!(judged).to_string() + "\n";
        self.file.write_all(line.as_bytes()).map_err(|e| Error::io(&self.path, e))
    }

    /// Deletes the journal of a finished search.
    pub fn remove(self) -> Result<()> {
        std::fs::remove_file(&self.path).map_err(|e| Error::io(&self.path, e))
    }
}
