//! Weights as files, each written whole or not at all.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::whole::write_whole;
use crate::error::{Error, Result};

/// Where blobs are kept.
pub enum Blobs {
    Memory(Mutex<HashMap<String, Vec<u8>>>),
    Directory(PathBuf),
}

impl Blobs {
    pub fn memory() -> Blobs {
        Blobs::Memory(Mutex::default())
    }

    pub fn directory(path: &Path) -> Result<Blobs> {
        fs::create_dir_all(path).map_err(|e| Error::io(path, e))?;
        Ok(Blobs::Directory(path.to_path_buf()))
    }

    /// Writes all of `bytes` under `name`, or nothing.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        match self {
            Blobs::Memory(map) => {
                map.lock().unwrap_or_else(PoisonError::into_inner).insert(name.into(), bytes.to_vec());
                Ok(())
            }
            Blobs::Directory(directory) => write_whole(&directory.join(name), bytes),
        }
    }

    pub fn read(&self, name: &str) -> Result<Vec<u8>> {
        match self {
            Blobs::Memory(map) => {
                let map = map.lock().unwrap_or_else(PoisonError::into_inner);
                map.get(name).cloned().ok_or_else(|| Error::Failed(format!("the weights {name} are gone")))
            }
            Blobs::Directory(directory) => {
                let path = directory.join(name);
                fs::read(&path).map_err(|e| Error::io(&path, e))
            }
        }
    }

    /// Removes what `keep` does not want; what cannot be removed stays and does no harm.
    pub fn retain(&self, keep: impl Fn(&str) -> bool) -> Result<()> {
        match self {
            Blobs::Memory(map) => {
                map.lock().unwrap_or_else(PoisonError::into_inner).retain(|name, _| keep(name));
            }
            Blobs::Directory(directory) => {
                for entry in fs::read_dir(directory).map_err(|e| Error::io(directory, e))? {
                    let entry = entry.map_err(|e| Error::io(directory, e))?;
                    if !entry.file_name().to_str().is_some_and(&keep) {
                        let _ = fs::remove_file(entry.path());
                    }
                }
            }
        }
        Ok(())
    }
}
