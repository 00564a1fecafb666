//! What every handler shares.

use std::collections::HashSet;
use std::ops::Deref;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::Semaphore;

use super::config::{Clock, ServeConfig};
use super::metrics::Metrics;
use super::problem::{Answer, Problem, explain};
use crate::error::Result;
use crate::job::{Recipes, Runner, RunnerConfig};
use crate::session::{Catalogue, Registry, RegistryConfig};
use crate::store::Store;

/// What requests and jobs share.
pub struct Base {
    pub catalogue: Catalogue,
    pub worlds: Registry,
    pub store: Arc<Store>,
    pub metrics: Metrics,
    pub clock: Clock,
}

/// The server's state.
pub struct App {
    base: Arc<Base>,
    pub jobs: Runner,
    /// The OpenAPI document, JSON.
    pub document: &'static str,
    /// Set once the server is to stop.
    pub stopping: tokio::sync::watch::Sender<bool>,
    /// Held while answers to proposals are taken.
    pub telling: Mutex<()>,
    /// Keys of the requests that are being worked on.
    keys: Mutex<HashSet<String>>,
    busy: AtomicUsize,
    at_work: Arc<Semaphore>,
    streamed: Arc<Semaphore>,
    /// Distinguishes this server's world ids from those of earlier ones.
    nonce: u32,
    made: AtomicU64,
}

/// Requests taken in at a time; more are told to come back.
const MOST_BUSY: usize = 512;
/// Of these, worked on at a time; the others wait without a thread. Above the number of cores, as some wait for the
/// disk or for a world's turn.
const AT_WORK: usize = 32;
/// Answers at a time that are written as their clients read them.
const STREAMED: usize = 32;
/// Threads for all of this and for what the server does by itself. More would each keep a stack and an arena, and a
/// busy machine makes as many as it may.
pub const THREADS: usize = AT_WORK + STREAMED + 8;

impl App {
    /// Opens the store, assembles the tasks and makes the default worlds. `recipes` make the work of jobs.
    pub fn new(
        config: &ServeConfig,
        recipes: fn(&Arc<Base>) -> Recipes,
        document: &'static str,
    ) -> Result<App> {
        let store = Arc::new(match &config.data_dir {
            Some(directory) => Store::open(directory)?,
            None => Store::in_memory()?,
        });
        let catalogue = Catalogue::new();
        let limits = RegistryConfig { limit: config.worlds, idle: config.idle };
        let runner = RunnerConfig { workers: config.workers, queue: config.queue, threads: 0, explain };
        let base = Arc::new(Base {
            worlds: Registry::new(limits, &catalogue, store.clone())?,
            catalogue,
            store: store.clone(),
            metrics: Metrics::default(),
            clock: config.clock.clone(),
        });
        Ok(App {
            jobs: Runner::start(store, recipes(&base), runner)?,
            base,
            document,
            stopping: tokio::sync::watch::Sender::new(false),
            telling: Mutex::default(),
            keys: Mutex::default(),
            busy: AtomicUsize::new(0),
            at_work: Arc::new(Semaphore::new(AT_WORK)),
            streamed: Arc::new(Semaphore::new(STREAMED)),
            nonce: nonce(),
            made: AtomicU64::new(0),
        })
    }

    /// An id that no world of this or an earlier server has.
    pub fn world_id(&self) -> String {
        format!("w{:08x}-{}", self.nonce, self.made.fetch_add(1, Ordering::Relaxed))
    }

    /// Runs `work` off the async threads.
    pub async fn run<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&App) -> Answer<T> + Send + 'static,
    ) -> Answer<T> {
        self.run_among(&self.at_work, work).await
    }

    /// The same for work that waits for its client: it does not keep others from theirs.
    pub async fn run_streamed<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&App) -> Answer<T> + Send + 'static,
    ) -> Answer<T> {
        self.run_among(&self.streamed, work).await
    }

    async fn run_among<T: Send + 'static>(
        self: &Arc<Self>,
        places: &Arc<Semaphore>,
        work: impl FnOnce(&App) -> Answer<T> + Send + 'static,
    ) -> Answer<T> {
        if self.busy.fetch_add(1, Ordering::SeqCst) >= MOST_BUSY {
            self.busy.fetch_sub(1, Ordering::SeqCst);
            return Err(Problem::busy(MOST_BUSY));
        }
        let place = Place(self.clone());
        // Kept until the work is done, also if nobody waits for it any more. Never closed.
        let turn = places.clone().acquire_owned().await;
        let work = move || {
            let _turn = turn;
            work(&place.0)
        };
        let done = tokio::task::spawn_blocking(work).await;
        done.unwrap_or_else(|e| {
            tracing::error!("a request's work panicked: {e}");
            Err(Problem::defect())
        })
    }
}

impl Base {
    /// Now, by the server's clock.
    pub fn now(&self) -> Duration {
        (self.clock)()
    }
}

impl Deref for App {
    type Target = Base;

    fn deref(&self) -> &Base {
        &self.base
    }
}

/// A key that is being worked on; free again when dropped.
pub struct Held<'a> {
    app: &'a App,
    key: String,
}

impl App {
    /// Takes a key, unless a request with the same one is being worked on.
    pub fn hold(&self, key: &str) -> Option<Held<'_>> {
        let new = self.keys.lock().unwrap_or_else(PoisonError::into_inner).insert(key.into());
        new.then(|| Held { app: self, key: key.into() })
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.app.keys.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.key);
    }
}

/// One of [`MOST_BUSY`]; given back when dropped, after a panic too.
struct Place(Arc<App>);

impl Drop for Place {
    fn drop(&mut self) {
        self.0.busy.fetch_sub(1, Ordering::SeqCst);
    }
}

/// A number that differs from process to process.
fn nonce() -> u32 {
    use std::hash::{BuildHasher, RandomState};
    RandomState::new().hash_one(std::process::id()) as u32
}
