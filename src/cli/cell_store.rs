//! Cached parts ("cells") of an experiment as files, from which an interrupted experiment resumes.

use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use iplw::error::{Error, Result};
use iplw::progress::Progress;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::cli::output::{self, TerminalProgress};
use iplw::sync::lock;

/// A directory of finished cells.
pub struct CellStore {
    directory: PathBuf,
    bar: TerminalProgress,
    started: Instant,
    /// Digest of the program.
    build: u64,
    /// Total number of cells.
    total: usize,
    counts: Mutex<CellCounts>,
}

#[derive(Default)]
struct CellCounts {
    /// Cells requested so far.
    seen: usize,
    /// Cells computed in this run.
    computed: usize,
    /// Total time of all cells requested so far, s.
    seconds: f64,
}

/// The file of a cell. Files of another configuration, version or build are recomputed.
#[derive(Serialize, Deserialize)]
struct CellFile {
    version: String,
    build: u64,
    config: Value,
    /// Time of the computation, s.
    seconds: f64,
    value: Value,
}

impl CellStore {
    /// A store of `total` cells under `out`.
    pub fn new(out: &Path, total: usize) -> Result<CellStore> {
        let directory = out.join("cells");
        output::prepare_directory("--out", &directory)?;
        let (bar, started, counts) = (TerminalProgress::new(), Instant::now(), Mutex::default());
        Ok(CellStore { directory, bar, started, build: build_digest()?, total, counts })
    }

    /// Loads or computes the cells of `items` in parallel. `named` returns a cell's name and everything it depends on. The first error is
    /// returned; finished cells are kept.
    pub fn compute_all<I: Sync, T: Serialize + DeserializeOwned + Send>(
        &self,
        items: &[I],
        named: impl Fn(&I) -> (String, Value) + Sync,
        make: impl Fn(&I) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        let results: Vec<Mutex<Option<T>>> = items.iter().map(|_| Mutex::new(None)).collect();
        let next = AtomicUsize::new(0);
        let failed = Mutex::new(None);
        let work = || {
            while lock(&failed).is_none() {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(item) = items.get(i) else { break };
                let (key, config) = named(item);
                // The stages of parallel cells aren't reported, since they would flicker.
                match self.get_or_compute(&key, &config, |_| make(item)) {
                    Ok((value, _)) => *lock(&results[i]) = Some(value),
                    Err(error) => *lock(&failed) = Some(error),
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..rayon::current_num_threads().min(items.len()) {
                scope.spawn(work);
            }
        });
        if let Some(error) = failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error);
        }
        let values = results.into_iter().map(|s| s.into_inner().unwrap_or_else(PoisonError::into_inner));
        values.map(|v| v.ok_or_else(|| Error::Failed("a cell was not computed".into()))).collect()
    }

    /// Loads or computes the cell called `key`; returns its value and the seconds of its computation. `config` is everything it depends
    /// on.
    pub fn get_or_compute<T: Serialize + DeserializeOwned>(
        &self,
        key: &str,
        config: &impl Serialize,
        make: impl FnOnce(&dyn Progress) -> Result<T>,
    ) -> Result<(T, f64)> {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '.' { c } else { '-' };
        let path = self.directory.join(format!("{}.json", key.chars().map(plain).collect::<String>()));
        let config = serde_json::to_value(config).map_err(|e| Error::Failed(e.to_string()))?;
        let place = self.next();
        if let Some((value, seconds)) = load_cell(&path, &config, self.build) {
            lock(&self.counts).seconds += seconds;
            return Ok((value, seconds));
        }
        let named = CellProgress { bar: &self.bar, name: format!("{place}: {key}") };
        named.report("begun", 0, 1)?;
        let started = Instant::now();
        let value = make(&named)?;
        let seconds = started.elapsed().as_secs_f64();
        let text = serde_json::to_value(&value).map_err(|e| Error::Failed(e.to_string()))?;
        let version = env!("CARGO_PKG_VERSION").into();
        let file = CellFile { version, build: self.build, config, seconds, value: text };
        let text = serde_json::to_string(&file).map_err(|e| Error::Failed(e.to_string()))?;
        output::write_whole(&path, text.as_bytes())?;
        let mut counts = lock(&self.counts);
        counts.computed += 1;
        counts.seconds += seconds;
        Ok((value, seconds))
    }

    /// Removes the progress bar; returns the total time of all cells, s.
    pub fn finish(&self) -> f64 {
        self.bar.clear();
        lock(&self.counts).seconds
    }

    /// Counts a cell; returns its number, the total, and the estimated remaining time.
    fn next(&self) -> String {
        let mut counts = lock(&self.counts);
        counts.seen += 1;
        let left = match counts.computed {
            0 => String::new(),
            n => {
                let each = self.started.elapsed().as_secs_f64() / n as f64;
                format!(
                    ", about {:.0} min left",
                    (each * (self.total - counts.seen + 1) as f64 / 60.0).ceil()
                )
            }
        };
        format!("{} of {}{left}", counts.seen, self.total)
    }
}

fn load_cell<T: DeserializeOwned>(path: &Path, config: &Value, build: u64) -> Option<(T, f64)> {
    let file: CellFile = serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()?;
    if file.config != *config || file.version != env!("CARGO_PKG_VERSION") || file.build != build {
        return None;
    }
    Some((serde_json::from_value(file.value).ok()?, file.seconds))
}

/// Digest of the program file, which distinguishes builds of the same version.
fn build_digest() -> Result<u64> {
    let own = std::env::current_exe().and_then(std::fs::read);
    let own = own.map_err(|e| Error::Failed(format!("cannot read the program's own file: {e}")))?;
    let mut hasher = DefaultHasher::new();
    hasher.write(&own);
    Ok(hasher.finish())
}

/// Progress that prefixes every stage with the cell's name.
struct CellProgress<'a> {
    bar: &'a TerminalProgress,
    name: String,
}

impl Progress for CellProgress<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.bar.report(&format!("{}: {stage}", self.name), done, total)
    }
}
