//! What all requests and jobs share.

use std::collections::HashSet;
use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::config::{Clock, ServeConfig};
use super::crowd::{Crowd, Room};
use super::fair::Fair;
use super::limits::Limits;
use super::log::Log;
use super::metrics::Metrics;
use super::prepared::{Most, Prepared};
use super::problem::explain;
use crate::access::Keyring;
use crate::discover::posterior::Likelihood;
use crate::error::{Error, Result};
use crate::job::{Recipes, Runner, RunnerConfig};
use crate::session::{Catalogue, Registry, RegistryConfig};
use crate::store::Store;

/// What is nobody's own.
pub struct Common {
    pub catalogue: Catalogue,
    pub metrics: Metrics,
    pub clock: Clock,
}

/// What jobs share: everything there is, whosever it is. What they are to use was looked at when they were queued.
pub struct Base {
    common: Common,
    pub worlds: Registry,
    pub store: Arc<Store>,
    pub likelihoods: Prepared<Likelihood>,
}

/// The server's state.
pub struct Shared {
    pub base: Arc<Base>,
    pub jobs: Runner,
    pub keyring: Keyring,
    /// The OpenAPI document, JSON.
    pub document: &'static str,
    /// Set once the server is to stop.
    pub stopping: tokio::sync::watch::Sender<bool>,
    /// Held while answers to proposals are taken.
    pub telling: Mutex<()>,
    /// Keys of the requests that are being worked on.
    pub keys: Mutex<HashSet<String>>,
    /// What is shared out between clients.
    pub fair: Fair,
    /// Connections over HTTP.
    pub http: Arc<Crowd>,
    /// Connections over ZeroMQ.
    pub zmq: Arc<Crowd>,
    pub limits: Limits,
    pub log: Log,
    /// Distinguishes this server's world ids from those of earlier ones.
    nonce: u32,
    made: AtomicU64,
    asked: AtomicU64,
}

/// Likelihoods that are kept ready.
const LIKELIHOODS: Most = Most { things: 8, bytes: 256 << 20 };

/// Connections over ZeroMQ at a time; more are hung up on.
const MOST_PEERS: usize = 4096;

impl Shared {
    /// How long a request may go on; `asked` is what its client grants it, s, as it was sent.
    pub fn span(&self, field: &str, asked: Option<&str>) -> Result<Duration> {
        let most = self.limits.request_seconds;
        let Some(asked) = asked else { return Ok(Limits::span(most)) };
        let seconds = asked.trim().parse().ok().filter(|s: &f64| *s >= 0.001 && *s <= most);
        let allowed = format!("seconds, from 0.001 to {most}");
        seconds.map(Limits::span).ok_or_else(|| Error::input(field, format!("{asked:?}"), allowed))
    }

    /// Opens the store, assembles the tasks and makes the default worlds. `recipes` make the work of jobs.
    pub fn new(
        config: &ServeConfig,
        keyring: Keyring,
        recipes: fn(&Arc<Base>) -> Recipes,
        document: &'static str,
    ) -> Result<Shared> {
        let store = Arc::new(match &config.data_dir {
            Some(directory) => Store::open(directory)?,
            None => Store::in_memory()?,
        });
        let catalogue = Catalogue::new();
        let limits = &config.limits;
        let idle = Limits::span(limits.world_idle_seconds);
        let registry = RegistryConfig { limit: limits.worlds, idle, request: limits.of_request() };
        let runner = RunnerConfig {
            workers: limits.jobs_running,
            queue: limits.jobs_waiting,
            threads: 0,
            most: limits.job_seconds.map(Limits::span),
            explain,
        };
        let worlds = Registry::new(registry, &catalogue, store.clone())?;
        let common = Common { catalogue, metrics: Metrics::default(), clock: config.clock.clone() };
        let base =
            Arc::new(Base { common, worlds, store: store.clone(), likelihoods: Prepared::new(LIKELIHOODS) });
        let log = config.log.clone();
        Ok(Shared {
            jobs: Runner::start(store, recipes(&base), runner, Box::new(move |row| log.job(row)))?,
            base,
            keyring,
            document,
            stopping: tokio::sync::watch::Sender::new(false),
            telling: Mutex::default(),
            keys: Mutex::default(),
            fair: Fair::new(),
            http: Crowd::new(Room { most: limits.connections, each: limits.client_connections, kept: 0 }),
            zmq: Crowd::new(Room { most: MOST_PEERS, each: limits.client_connections, kept: 0 }),
            limits: config.limits.clone(),
            log: config.log.clone(),
            nonce: nonce(),
            made: AtomicU64::new(0),
            asked: AtomicU64::new(0),
        })
    }

    /// A request's id: no other of this or an earlier server has it.
    pub fn request_id(&self) -> String {
        format!("{:08x}-{}", self.nonce, self.asked.fetch_add(1, Ordering::Relaxed))
    }

    /// An id that no world of this or an earlier server has.
    pub fn world_id(&self) -> String {
        format!("w{:08x}-{}", self.nonce, self.made.fetch_add(1, Ordering::Relaxed))
    }
}

impl Common {
    /// Now, by the server's clock.
    pub fn now(&self) -> Duration {
        (self.clock)()
    }
}

impl Deref for Base {
    type Target = Common;

    fn deref(&self) -> &Common {
        &self.common
    }
}

/// A number that differs from process to process.
fn nonce() -> u32 {
    use std::hash::{BuildHasher, RandomState};
    RandomState::new().hash_one(std::process::id()) as u32
}
