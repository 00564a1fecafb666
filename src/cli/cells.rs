//! Experiments are cut into cells that are kept as files, so that one that was stopped goes on where it was.

use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
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
    /// The program that computes them.
    build: u64,
    /// All cells there will be.
    total: usize,
    counts: Mutex<Counts>,
}

#[derive(Default)]
struct Counts {
    /// Cells come by so far.
    seen: usize,
    /// Cells computed now.
    computed: usize,
    /// What all cells come by took.
    seconds: f64,
}

/// A cell as a file. One made by another configuration, version or build is computed anew.
#[derive(Serialize, Deserialize)]
struct File {
    version: String,
    build: u64,
    config: Value,
    /// What computing it took, wall clock.
    seconds: f64,
    value: Value,
}

impl Cells {
    /// Cells under `out`, of which there will be `total`.
    pub fn new(out: &Path, total: usize) -> Result<Cells> {
        let directory = out.join("cells");
        output::directory("--out", &directory)?;
        let (bar, started, counts) = (Bar::new(), Instant::now(), Mutex::default());
        Ok(Cells { directory, bar, started, build: build()?, total, counts })
    }

    /// The cells of `items`, as they are kept or made by `make` and kept; as many at a time as there are threads to compute with.
    /// `named` gives a cell's name and everything it depends on. The first error ends it; what is done is kept.
    pub fn all<I: Sync, T: Serialize + DeserializeOwned + Send>(
        &self,
        items: &[I],
        named: impl Fn(&I) -> (String, Value) + Sync,
        make: impl Fn(&I) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        let slots: Vec<Mutex<Option<T>>> = items.iter().map(|_| Mutex::new(None)).collect();
        let next = AtomicUsize::new(0);
        let failed = Mutex::new(None);
        let work = || {
            while lock(&failed).is_none() {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(item) = items.get(i) else { break };
                let (key, config) = named(item);
                // Stages of cells side by side would only flicker.
                match self.get(&key, &config, |_| make(item)) {
                    Ok((value, _)) => *lock(&slots[i]) = Some(value),
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
        let values = slots.into_iter().map(|s| s.into_inner().unwrap_or_else(PoisonError::into_inner));
        values.map(|v| v.ok_or_else(|| Error::Failed("a cell was left out".into()))).collect()
    }

    /// The cell called `key`: as it is kept, or made by `make` and kept, with the seconds that took. `config` is
    /// everything it depends on.
    pub fn get<T: Serialize + DeserializeOwned>(
        &self,
        key: &str,
        config: &impl Serialize,
        make: impl FnOnce(&dyn Progress) -> Result<T>,
    ) -> Result<(T, f64)> {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '.' { c } else { '-' };
        let path = self.directory.join(format!("{}.json", key.chars().map(plain).collect::<String>()));
        let config = serde_json::to_value(config).map_err(|e| Error::Failed(e.to_string()))?;
        let place = self.next();
        if let Some((value, seconds)) = kept(&path, &config, self.build) {
            lock(&self.counts).seconds += seconds;
            return Ok((value, seconds));
        }
        let named = Named { bar: &self.bar, name: format!("{place}: {key}") };
        named.report("begun", 0, 1)?;
        let started = Instant::now();
        let value = make(&named)?;
        let seconds = started.elapsed().as_secs_f64();
        let text = serde_json::to_value(&value).map_err(|e| Error::Failed(e.to_string()))?;
        let version = env!("CARGO_PKG_VERSION").into();
        let file = File { version, build: self.build, config, seconds, value: text };
        let text = serde_json::to_string(&file).map_err(|e| Error::Failed(e.to_string()))?;
        output::write_whole(&path, text.as_bytes())?;
        let mut counts = lock(&self.counts);
        counts.computed += 1;
        counts.seconds += seconds;
        Ok((value, seconds))
    }

    /// Takes the progress bar away; the seconds of all cells together.
    pub fn finish(&self) -> f64 {
        self.bar.clear();
        lock(&self.counts).seconds
    }

    /// Counts one more cell: which of how many it is, and the time left.
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

fn kept<T: DeserializeOwned>(path: &Path, config: &Value, build: u64) -> Option<(T, f64)> {
    let file: File = serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()?;
    if file.config != *config || file.version != env!("CARGO_PKG_VERSION") || file.build != build {
        return None;
    }
    Some((serde_json::from_value(file.value).ok()?, file.seconds))
}

/// Tells programs apart that have the same version.
fn build() -> Result<u64> {
    let own = std::env::current_exe().and_then(std::fs::read);
    let own = own.map_err(|e| Error::Failed(format!("this program cannot read its own file: {e}")))?;
    let mut hasher = DefaultHasher::new();
    hasher.write(&own);
    Ok(hasher.finish())
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
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
