//! Archives of arrays, `.npz`: as `numpy.savez` writes and `numpy.load` reads them.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::fs::File;
use std::io::{Cursor, Read, Write};
use std::path::Path;

use iplw::error::{Error, Result};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::npy::{F64, header, parse};

/// An array of f64 in C order.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberArray {
    pub shape: Vec<usize>,
    pub values: Vec<f64>,
}

/// Maximum size of all arrays of an archive, bytes.
const MAX_ARCHIVE_BYTES: u64 = 8 << 30;

/// All arrays of an archive by name.
pub fn read(path: &Path) -> Result<BTreeMap<String, NumberArray>> {
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    let name = path.display().to_string();
    let no_archive = |e: zip::result::ZipError| {
        Error::input(&name, e, "an archive of arrays as `numpy.savez` writes it (.npz)")
    };
    let mut archive = ZipArchive::new(file).map_err(no_archive)?;
    let (mut arrays, mut left) = (BTreeMap::new(), MAX_ARCHIVE_BYTES);
    for i in 0..archive.len() {
        let member = archive.by_index(i).map_err(no_archive)?;
        let label = member.name().map_err(no_archive)?.trim_end_matches(".npy").to_string();
        let mut bytes = Vec::new();
        member.take(left + 1).read_to_end(&mut bytes).map_err(|e| Error::io(path, e))?;
        left = left.checked_sub(bytes.len() as u64).ok_or_else(|| {
            Error::input(&name, "larger", format!("arrays of at most {} GB", MAX_ARCHIVE_BYTES >> 30))
        })?;
        let (shape, data) = parse(&format!("{name}: {label}"), &bytes, F64, 8)?;
        let values = data.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        arrays.insert(label, NumberArray { shape, values });
    }
    Ok(arrays)
}

/// An archive in memory, written array by array.
pub struct ArchiveWriter(ZipWriter<Cursor<Vec<u8>>>);

/// Values of an array that are converted to bytes together.
const VALUES_PER_WRITE: usize = 1 << 16;

impl ArchiveWriter {
    /// An empty archive.
    pub fn new() -> ArchiveWriter {
        ArchiveWriter(ZipWriter::new(Cursor::new(Vec::new())))
    }

    /// Adds an array; `kind` is NumPy's name of the type.
    pub fn add(&mut self, name: &str, kind: &str, shape: &[usize], data: &[u8]) -> Result<()> {
        self.start(name, kind, shape)?;
        self.0.write_all(data).map_err(|e| failed(name, e))
    }

    /// Adds an array of f64.
    pub fn add_f64(&mut self, name: &str, shape: &[usize], values: &[f64]) -> Result<()> {
        self.start(name, F64, shape)?;
        let mut parts = values.chunks(VALUES_PER_WRITE);
        parts
            .try_for_each(|part| self.0.write_all(&little_endian(part, f64::to_le_bytes)))
            .map_err(|e| failed(name, e))
    }

    fn start(&mut self, name: &str, kind: &str, shape: &[usize]) -> Result<()> {
        let options =
            SimpleFileOptions::default().compression_method(CompressionMethod::Stored).large_file(true);
        self.0.start_file(format!("{name}.npy"), options).map_err(|e| failed(name, e))?;
        self.0.write_all(&header(kind, shape)).map_err(|e| failed(name, e))
    }

    /// Adds texts.
    pub fn add_texts(&mut self, name: &str, shape: &[usize], texts: &[&str]) -> Result<()> {
        let longest = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
        let mut data = Vec::new();
        for text in texts {
            let padded = text.chars().map(u32::from).chain(std::iter::repeat(0)).take(longest);
            data.extend(padded.flat_map(u32::to_le_bytes));
        }
        self.add(name, &format!("<U{longest}"), shape, &data)
    }

    /// The bytes of the complete archive.
    pub fn finish(self) -> Result<Vec<u8>> {
        let done = self.0.finish().map_err(|e| Error::Failed(format!("cannot complete the archive: {e}")))?;
        Ok(done.into_inner())
    }
}

fn failed(name: &str, e: impl Display) -> Error {
    Error::Failed(format!("cannot write the array {name}: {e}"))
}

/// Values as bytes.
pub fn little_endian<T: Copy, const N: usize>(values: &[T], bytes: fn(T) -> [u8; N]) -> Vec<u8> {
    values.iter().flat_map(|value| bytes(*value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn archives_are_read_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let mut writer = ArchiveWriter::new();
        writer.add_f64("x", &[2, 2], &[1.0, -0.5, f64::MAX, 0.0]).unwrap();
        writer.add_f64("y.c", &[1], &[3.0]).unwrap();
        std::fs::write(&path, writer.finish().unwrap()).unwrap();
        let arrays = read(&path).unwrap();
        assert_eq!(arrays["x"], NumberArray { shape: vec![2, 2], values: vec![1.0, -0.5, f64::MAX, 0.0] });
        assert_eq!(arrays["y.c"], NumberArray { shape: vec![1], values: vec![3.0] });
        std::fs::write(&path, b"no archive").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("numpy.savez"));
    }
}
