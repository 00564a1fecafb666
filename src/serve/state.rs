//! Application state, in three layers: [`CommonState`] in [`CoreState`] in [`AppState`].

use std::collections::HashSet;
use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::cache::{BoundedCache, CacheLimits};
use super::client_limiter::{ClientLimiter, LimiterCapacity};
use super::config::{Clock, LimitsReader, ServeConfig};
use super::control_worlds::ControlWorlds;
use super::limits::Limits;
use super::log::AccessLog;
use super::metrics::Metrics;
use super::problem::explain;
use super::readiness::DiskProbe;
use super::scheduler::FairScheduler;
use crate::access::Keyring;
use crate::error::{Error, Result};
use crate::inference::posterior::TrialLikelihood;
use crate::job::{Runner, RunnerConfig, WorkFactories};
use crate::session::{Catalogue, Registry, RegistryConfig};
use crate::store::Store;
use crate::sync::lock;

/// State without an owner.
pub struct CommonState {
    pub catalogue: Catalogue,
    pub metrics: Metrics,
    pub clock: Clock,
}

/// State used by jobs: all worlds and stored data, regardless of owner. Permissions were checked when the job was queued.
pub struct CoreState {
    common: CommonState,
    pub worlds: Registry,
    pub store: Arc<Store>,
    pub likelihoods: BoundedCache<TrialLikelihood>,
    pub control_worlds: ControlWorlds,
}

/// State of the server.
pub struct AppState {
    pub core: Arc<CoreState>,
    pub jobs: Runner,
    pub keyring: Keyring,
    /// The OpenAPI document, JSON.
    pub document: &'static str,
    /// Set when the server is to stop.
    pub stopping: tokio::sync::watch::Sender<bool>,
    /// Held while results of proposed trials are submitted.
    pub submission_lock: Mutex<()>,
    /// Idempotency keys of requests in progress.
    pub keys_in_progress: Mutex<HashSet<String>>,
    /// Fair sharing between clients.
    pub scheduler: FairScheduler,
    /// Bytes of request bodies.
    pub body_bytes: Arc<ClientLimiter>,
    /// Whether the disk takes writes.
    pub disk: DiskProbe,
    /// HTTP connections.
    pub http_connections: Arc<ClientLimiter>,
    /// ZeroMQ connections.
    pub zmq_connections: Arc<ClientLimiter>,
    limits: Mutex<Arc<Limits>>,
    read_limits: Option<LimitsReader>,
    pub log: AccessLog,
    /// Distinguishes this server's ids from those of earlier ones.
    nonce: u32,
    worlds_created: AtomicU64,
    requests_received: AtomicU64,
}

/// Capacity of the likelihood cache.
const LIKELIHOOD_CACHE_LIMITS: CacheLimits = CacheLimits { entries: 8, bytes: 256 << 20 };

/// Maximum ZeroMQ connections; further ones are closed.
const MAX_ZMQ_CONNECTIONS: usize = 4096;

impl AppState {
    /// Timeout of a request; `requested` is the client's header or field, s.
    pub fn request_timeout(&self, field: &str, requested: Option<&str>) -> Result<Duration> {
        let most = self.limits().request_seconds;
        let Some(requested) = requested else { return Ok(Limits::duration(most)) };
        let seconds = requested.trim().parse().ok().filter(|s: &f64| *s >= 0.001 && *s <= most);
        let allowed = format!("seconds, from 0.001 to {most}");
        seconds.map(Limits::duration).ok_or_else(|| Error::input(field, format!("{requested:?}"), allowed))
    }

    /// Opens the store, loads the tasks and creates the default worlds. `work_factories` build the work of jobs.
    pub fn new(
        config: &ServeConfig,
        keyring: Keyring,
        work_factories: fn(&Arc<CoreState>) -> WorkFactories,
        document: &'static str,
    ) -> Result<AppState> {
        let store = Arc::new(match &config.data_dir {
            Some(directory) => Store::open(directory)?,
            None => Store::in_memory()?,
        });
        let catalogue = Catalogue::new();
        let limits = &config.limits;
        let worlds = Registry::new(registry_config(limits), &catalogue, store.clone())?;
        let common = CommonState { catalogue, metrics: Metrics::default(), clock: config.clock.clone() };
        let core = Arc::new(CoreState {
            common,
            worlds,
            store: store.clone(),
            likelihoods: BoundedCache::new(LIKELIHOOD_CACHE_LIMITS),
            control_worlds: ControlWorlds::default(),
        });
        let log = config.log.clone();
        Ok(AppState {
            jobs: Runner::start(
                store,
                work_factories(&core),
                runner_config(limits),
                Box::new(move |row| log.job(row)),
            )?,
            core,
            keyring,
            document,
            stopping: tokio::sync::watch::Sender::new(false),
            submission_lock: Mutex::default(),
            keys_in_progress: Mutex::default(),
            scheduler: FairScheduler::new(),
            body_bytes: ClientLimiter::new(body_capacity(limits)),
            disk: DiskProbe::default(),
            http_connections: ClientLimiter::new(connection_capacity(limits, limits.connections)),
            zmq_connections: ClientLimiter::new(connection_capacity(limits, MAX_ZMQ_CONNECTIONS)),
            limits: Mutex::new(Arc::new(config.limits.clone())),
            read_limits: config.read_limits.clone(),
            log: config.log.clone(),
            nonce: nonce(),
            worlds_created: AtomicU64::new(0),
            requests_received: AtomicU64::new(0),
        })
    }

    /// The limits in force.
    pub fn limits(&self) -> Arc<Limits> {
        lock(&self.limits).clone()
    }

    /// Limits of worlds.
    pub fn registry_config(&self) -> RegistryConfig {
        registry_config(&self.limits())
    }

    /// Reads tokens and limits again; on an error the previous ones stay in force. Limits of one request apply to worlds made
    /// afterwards.
    pub fn reload(&self) -> Result<()> {
        self.keyring.refresh()?;
        let Some(read_limits) = &self.read_limits else { return Ok(()) };
        let limits = read_limits()?;
        self.http_connections.set_capacity(connection_capacity(&limits, limits.connections));
        self.zmq_connections.set_capacity(connection_capacity(&limits, MAX_ZMQ_CONNECTIONS));
        self.body_bytes.set_capacity(body_capacity(&limits));
        self.core.worlds.set_config(registry_config(&limits));
        self.jobs.set_config(runner_config(&limits));
        *lock(&self.limits) = Arc::new(limits);
        Ok(())
    }

    /// A request id, unique over this and earlier servers.
    pub fn request_id(&self) -> String {
        format!("{:08x}-{}", self.nonce, self.requests_received.fetch_add(1, Ordering::Relaxed))
    }

    /// A world id, unique over this and earlier servers.
    pub fn world_id(&self) -> String {
        format!("w{:08x}-{}", self.nonce, self.worlds_created.fetch_add(1, Ordering::Relaxed))
    }
}

fn registry_config(limits: &Limits) -> RegistryConfig {
    let idle = Limits::duration(limits.world_idle_seconds);
    RegistryConfig {
        limit: limits.worlds,
        owner_limit: limits.owner_worlds,
        idle,
        request: limits.request_limits(),
    }
}

fn runner_config(limits: &Limits) -> RunnerConfig {
    RunnerConfig {
        running: limits.jobs_running,
        queue: limits.jobs_waiting,
        owner_queue: limits.owner_jobs,
        threads: 0,
        max_run_time: limits.job_seconds.map(Limits::duration),
        explain,
    }
}

fn body_capacity(limits: &Limits) -> LimiterCapacity {
    LimiterCapacity {
        total: limits.body_bytes as usize,
        per_client: limits.client_body_bytes as usize,
        reserved_per_client: 0,
    }
}

fn connection_capacity(limits: &Limits, total: usize) -> LimiterCapacity {
    LimiterCapacity { total, per_client: limits.client_connections, reserved_per_client: 0 }
}

impl CommonState {
    /// The server's clock.
    pub fn now(&self) -> Duration {
        (self.clock)()
    }
}

impl Deref for CoreState {
    type Target = CommonState;

    fn deref(&self) -> &CommonState {
        &self.common
    }
}

/// A number that differs between processes.
fn nonce() -> u32 {
    use std::hash::{BuildHasher, RandomState};
    RandomState::new().hash_one(std::process::id()) as u32
}
