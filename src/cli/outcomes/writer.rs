//! Writing tables of outcomes row by row, as NumPy arrays.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use serde_json::Value;

use crate::cli::arrays::npy::{I8, npy};
use crate::cli::output;

/// A table in progress: rows are appended to `outcomes.part` until it is complete.
pub struct TableWriter {
    folder: PathBuf,
    /// Number of complete rows.
    pub rows: usize,
}

impl TableWriter {
    /// Starts a table of `rows` tasks and `width` actions, or resumes one with the same metadata. Other files are never overwritten.
    pub fn open(folder: &Path, of: &Value, [rows, width]: [usize; 2]) -> Result<TableWriter> {
        let mut table = TableWriter { folder: folder.into(), rows: 0 };
        let about = folder.join("outcomes.json");
        let there = ["outcomes.json", "outcomes.npy", "outcomes.part", "actions.npy"]
            .iter()
            .any(|f| folder.join(f).exists());
        if there {
            let text = std::fs::read_to_string(&about).unwrap_or_default();
            if serde_json::from_str::<Value>(&text).ok().as_ref() != Some(of) {
                let allowed = "another directory: this one has other files, or a table of other tasks, actions or physics";
                return Err(Error::input("--out", folder.display(), allowed));
            }
            if table.finished_path().exists() {
                eprintln!("  the table is complete");
                return Ok(TableWriter { rows, ..table });
            }
            table.rows = std::fs::metadata(table.partial_path()).map_or(0, |m| m.len() as usize / width);
        }
        // A partially written row is removed and recomputed.
        let part = OpenOptions::new().create(true).append(true).open(table.partial_path());
        let cut = part.and_then(|part| part.set_len((table.rows * width) as u64));
        cut.map_err(|e| Error::io(&table.partial_path(), e))?;
        if table.rows > 0 {
            eprintln!("  resumes after {} tasks in {}", table.rows, table.partial_path().display());
        }
        output::write_whole(&about, format!("{of:#}\n").as_bytes())?;
        Ok(table)
    }

    fn partial_path(&self) -> PathBuf {
        self.folder.join("outcomes.part")
    }

    fn finished_path(&self) -> PathBuf {
        self.folder.join("outcomes.npy")
    }

    pub fn add(&mut self, row: &[i8]) -> Result<()> {
        let bytes: Vec<u8> = row.iter().map(|o| *o as u8).collect();
        let added = OpenOptions::new().append(true).open(self.partial_path()).and_then(|mut part| {
            part.write_all(&bytes)?;
            part.sync_data()
        });
        added.map_err(|e| Error::io(&self.partial_path(), e))?;
        self.rows += 1;
        Ok(())
    }

    /// Writes the final array, removes the partial file, and returns the data.
    pub fn finish(self, [rows, columns]: [usize; 2]) -> Result<Vec<u8>> {
        let read = |path: PathBuf| std::fs::read(&path).map_err(|e| Error::io(&path, e));
        if self.finished_path().exists() {
            let bytes = read(self.finished_path())?;
            return match bytes.len().checked_sub(rows * columns) {
                Some(header) => Ok(bytes[header..].to_vec()),
                None => Err(Error::input(
                    "--out",
                    self.finished_path().display(),
                    "a complete table; this file is truncated",
                )),
            };
        }
        let found = read(self.partial_path())?;
        output::write_whole(&self.finished_path(), &npy(I8, &[rows, columns], &found))?;
        std::fs::remove_file(self.partial_path()).map_err(|e| Error::io(&self.partial_path(), e))?;
        Ok(found)
    }
}
