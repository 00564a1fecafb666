//! Weights as files, written atomically and verified when read.

use std::collections::HashMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use super::atomic_write::write_private;
use super::checksum::sha256;
use super::layout::is_blob_name;
use super::permissions;
use crate::error::{Error, Result};
use crate::sync::lock;

/// Storage of blobs.
pub enum Blobs {
    Memory(Mutex<HashMap<String, Vec<u8>>>),
    Directory(PathBuf),
}

impl Blobs {
    pub fn memory() -> Blobs {
        Blobs::Memory(Mutex::default())
    }

    pub fn directory(path: &Path) -> Result<Blobs> {
        permissions::make_directory(path)?;
        Ok(Blobs::Directory(path.to_path_buf()))
    }

    /// Writes `bytes` under `name`, atomically.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        match self {
            Blobs::Memory(map) => {
                lock(map).insert(name.into(), bytes.to_vec());
                Ok(())
            }
            Blobs::Directory(directory) => write_private(&directory.join(name), bytes),
        }
    }

    /// The blob `name`; errors unless its SHA-256 is `digest`.
    pub fn read(&self, name: &str, digest: &str) -> Result<Vec<u8>> {
        let damaged = |how: &str| Error::Damaged { what: format!("weights {name}"), how: how.into() };
        let bytes = self.bytes(name)?.ok_or_else(|| damaged("the file is missing"))?;
        if sha256(&bytes) == digest { Ok(bytes) } else { Err(damaged("the SHA-256 does not match")) }
    }

    /// SHA-256 of the blob `name`, if it can be read; errors if the permission is missing.
    pub fn digest(&self, name: &str) -> Result<Option<String>> {
        match self.bytes(name) {
            Ok(bytes) => Ok(bytes.map(|bytes| sha256(&bytes))),
            Err(e @ Error::Refused { .. }) => Err(e),
            Err(_) => Ok(None),
        }
    }

    /// Size of the blob `name`, bytes, if it exists; errors if the permission is missing.
    pub fn length(&self, name: &str) -> Result<Option<u64>> {
        match self {
            Blobs::Memory(map) => Ok(lock(map).get(name).map(|bytes| bytes.len() as u64)),
            Blobs::Directory(directory) => {
                let path = directory.join(name);
                match fs::metadata(&path) {
                    Ok(m) => Ok(Some(m.len())),
                    Err(e) if e.kind() == io::ErrorKind::PermissionDenied => {
                        Err(permissions::read_error(&path, e))
                    }
                    Err(_) => Ok(None),
                }
            }
        }
    }

    fn bytes(&self, name: &str) -> Result<Option<Vec<u8>>> {
        match self {
            Blobs::Memory(map) => Ok(lock(map).get(name).cloned()),
            Blobs::Directory(directory) => {
                let path = directory.join(name);
                match fs::read(&path) {
                    Ok(bytes) => Ok(Some(bytes)),
                    Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
                    Err(e) => Err(permissions::read_error(&path, e)),
                }
            }
        }
    }

    /// Removes the blob `name`; a file that cannot be removed is left to the next [`Blobs::retain`].
    pub fn remove(&self, name: &str) {
        match self {
            Blobs::Memory(map) => drop(lock(map).remove(name)),
            Blobs::Directory(directory) => drop(fs::remove_file(directory.join(name))),
        }
    }

    /// Removes the blobs that `keep` rejects; files that cannot be removed are left. Files with names of others, directories and
    /// links are not touched.
    pub fn retain(&self, keep: impl Fn(&str) -> bool) -> Result<()> {
        match self {
            Blobs::Memory(map) => lock(map).retain(|name, _| keep(name)),
            Blobs::Directory(directory) => {
                for entry in fs::read_dir(directory).map_err(|e| Error::io(directory, e))? {
                    let entry = entry.map_err(|e| Error::io(directory, e))?;
                    let stale = entry.file_name().to_str().is_some_and(|n| is_blob_name(n) && !keep(n));
                    if stale && entry.file_type().is_ok_and(|t| t.is_file()) {
                        let _ = fs::remove_file(entry.path());
                    }
                }
            }
        }
        Ok(())
    }
}
