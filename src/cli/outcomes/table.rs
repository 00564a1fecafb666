//! Writing a table: rows are added as they are found, and arrays are as NumPy reads them.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use serde_json::Value;

use crate::cli::output;

/// A table that is being made: rows are added to `outcomes.part` until all are there.
pub struct Table {
    folder: PathBuf,
    /// Rows that are there.
    pub rows: usize,
}

impl Table {
    /// Begins a table of so many tasks and actions, or goes on with one of the same. Another's, and whatever else has its files'
    /// names, is left alone.
    pub fn open(folder: &Path, of: &Value, [rows, width]: [usize; 2]) -> Result<Table> {
        let mut table = Table { folder: folder.into(), rows: 0 };
        let about = folder.join("outcomes.json");
        let there = ["outcomes.json", "outcomes.npy", "outcomes.part", "actions.npy"]
            .iter()
            .any(|f| folder.join(f).exists());
        if there {
            let text = std::fs::read_to_string(&about).unwrap_or_default();
            if serde_json::from_str::<Value>(&text).ok().as_ref() != Some(of) {
                let allowed = "another directory: there is something else, or a table of other tasks, actions or physics";
                return Err(Error::input("--out", folder.display(), allowed));
            }
            if table.whole().exists() {
                eprintln!("  all of it is there");
                return Ok(Table { rows, ..table });
            }
            table.rows = std::fs::metadata(table.part()).map_or(0, |m| m.len() as usize / width);
        }
        // A row that was half written when the work was stopped is found again.
        let part = OpenOptions::new().create(true).append(true).open(table.part());
        let cut = part.and_then(|part| part.set_len((table.rows * width) as u64));
        cut.map_err(|e| Error::io(&table.part(), e))?;
        if table.rows > 0 {
            eprintln!("  goes on after {} tasks in {}", table.rows, table.part().display());
        }
        output::write_whole(&about, format!("{of:#}\n").as_bytes())?;
        Ok(table)
    }

    fn part(&self) -> PathBuf {
        self.folder.join("outcomes.part")
    }

    fn whole(&self) -> PathBuf {
        self.folder.join("outcomes.npy")
    }

    pub fn add(&mut self, row: &[i8]) -> Result<()> {
        let bytes: Vec<u8> = row.iter().map(|o| *o as u8).collect();
        let added = OpenOptions::new().append(true).open(self.part()).and_then(|mut part| {
            part.write_all(&bytes)?;
            part.sync_data()
        });
        added.map_err(|e| Error::io(&self.part(), e))?;
        self.rows += 1;
        Ok(())
    }

    /// The array takes the place of its parts; what it holds.
    pub fn finish(self, [rows, columns]: [usize; 2]) -> Result<Vec<u8>> {
        let read = |path: PathBuf| std::fs::read(&path).map_err(|e| Error::io(&path, e));
        if self.whole().exists() {
            let bytes = read(self.whole())?;
            return match bytes.len().checked_sub(rows * columns) {
                Some(header) => Ok(bytes[header..].to_vec()),
                None => Err(Error::input(
                    "--out",
                    self.whole().display(),
                    "a whole table: this one was cut short",
                )),
            };
        }
        let found = read(self.part())?;
        output::write_whole(&self.whole(), &npy("|i1", [rows, columns], &found))?;
        std::fs::remove_file(self.part()).map_err(|e| Error::io(&self.part(), e))?;
        Ok(found)
    }
}

/// A two-dimensional array as NumPy reads it (version 1.0 of its format), rows one after the other.
pub fn npy(kind: &str, [rows, columns]: [usize; 2], data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    // Data begin at a multiple of 64, after a line's end.
    let length = (10 + header.len() + 1).next_multiple_of(64) - 10;
    header += &" ".repeat(length - 1 - header.len());
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_begin_where_numpy_looks_for_them() {
        let bytes = npy("|i1", [2, 3], &[1, 255, 0, 1, 1, 0]);
        assert_eq!((bytes.len() - 6) % 64, 0);
        assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
        let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let header = std::str::from_utf8(&bytes[10..10 + length]).unwrap();
        assert!(
            header.starts_with("{'descr': '|i1', 'fortran_order': False, 'shape': (2, 3), }")
                && header.ends_with('\n')
        );
        assert_eq!(&bytes[10 + length..], [1, 255, 0, 1, 1, 0]);
    }
}
