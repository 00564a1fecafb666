//! Experiments are cut into cells that are kept as files, so that one that was stopped goes on where it was.

use std::path::{Path, PathBuf};
use std::time::Instant;

use iplw::error::{Error, Result};
use iplw::progress::Progress;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::cli::output::{self, Bar};

/// A directory of finished cells.
pub struct Cells {
    directory: PathBuf,
    bar: Bar,
    started: Instant,
    /// All cells there will be, those come by so far, and those computed now.
    total: usize,
    seen: usize,
    computed: usize,
}

/// A cell as a file. One made by another configuration or version is computed anew.
#[derive(Serialize, Deserialize)]
struct File {
    version: String,
    config: Value,
    /// What computing it took, wall clock.
    seconds: f64,
    value: Value,
}

impl Cells {
    /// Cells under `out`, of which there will be `total`.
    pub fn new(out: &Path, total: usize) -> Result<Cells> {
        let directory = out.join("cells");
        output::directory(&directory)?;
        Ok(Cells { directory, bar: Bar::new(), started: Instant::now(), total, seen: 0, computed: 0 })
    }

    /// The cell called `key`: as it is kept, or made by `make` and kept. `config` is everything it depends on.
    pub fn get<T: Serialize + DeserializeOwned>(
        &mut self,
        key: &str,
        config: &impl Serialize,
        make: impl FnOnce(&dyn Progress) -> Result<T>,
    ) -> Result<(T, f64)> {
        let name: String =
            key.chars().map(|c| if c.is_ascii_alphanumeric() || c == '.' { c } else { '-' }).collect();
        let path = self.directory.join(format!("{name}.json"));
        let config = serde_json::to_value(config).map_err(|e| Error::Failed(e.to_string()))?;
        self.seen += 1;
        if let Some((value, seconds)) = kept(&path, &config) {
            return Ok((value, seconds));
        }
        let left = match self.computed {
            0 => String::new(),
            n => {
                let each = self.started.elapsed().as_secs_f64() / n as f64;
                format!(", about {:.0} min left", (each * (self.total - self.seen + 1) as f64 / 60.0).ceil())
            }
        };
        let named = Named { bar: &self.bar, name: format!("{} of {}{left}: {key}", self.seen, self.total) };
        let started = Instant::now();
        let value = make(&named)?;
        self.computed += 1;
        let seconds = started.elapsed().as_secs_f64();
        let text = serde_json::to_value(&value).map_err(|e| Error::Failed(e.to_string()))?;
        let file = File { version: env!("CARGO_PKG_VERSION").into(), config, seconds, value: text };
        let text = serde_json::to_string(&file).map_err(|e| Error::Failed(e.to_string()))?;
        output::write_whole(&path, text.as_bytes())?;
        Ok((value, seconds))
    }

    /// Takes the progress bar away.
    pub fn finish(&self) {
        self.bar.clear();
    }
}

fn kept<T: DeserializeOwned>(path: &Path, config: &Value) -> Option<(T, f64)> {
    let file: File = serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()?;
    if file.config != *config || file.version != env!("CARGO_PKG_VERSION") {
        return None;
    }
    Some((serde_json::from_value(file.value).ok()?, file.seconds))
}

/// Puts the cell's name before every stage.
struct Named<'a> {
    bar: &'a Bar,
    name: String,
}

impl Progress for Named<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.bar.report(&format!("{}: {stage}", self.name), done, total)
    }
}
