//! Configuration of a server.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::limits::Limits;
use super::log::AccessLog;
use crate::error::Result;

/// Configuration of a server.
#[derive(Clone)]
pub struct ServeConfig {
    /// HTTP address; port 0 chooses a free one.
    pub http: SocketAddr,
    /// ZeroMQ address, if any: `tcp://HOST:PORT` or `ipc://PATH`.
    pub zmq: Option<String>,
    /// Data directory for jobs, worlds and policies; in memory if absent.
    pub data_dir: Option<PathBuf>,
    /// Limits and timeouts.
    pub limits: Limits,
    /// Reads the limits anew, at SIGHUP; absent if they never change.
    pub read_limits: Option<LimitsReader>,
    /// Token file instead of the data directory's.
    pub token_file: Option<PathBuf>,
    /// Further tokens, as JSON rows of a token file.
    pub tokens: Option<String>,
    /// PEM files of the TLS certificates and the private key.
    pub tls: Option<(PathBuf, PathBuf)>,
    /// Whether tokens may cross a network unencrypted, because a proxy encrypts.
    pub plaintext: bool,
    /// Whether the network may use the server without tokens.
    pub open_to_network: bool,
    /// Accepted `Host` names besides the server's addresses.
    pub allow_host: Vec<String>,
    /// Allowed CORS origins.
    pub allow_origin: Vec<String>,
    /// Access log.
    pub log: AccessLog,
    /// Monotonic clock.
    pub clock: Clock,
}

/// Reads limits.
pub type LimitsReader = Arc<dyn Fn() -> Result<Limits> + Send + Sync>;

/// Time since an arbitrary origin; never decreases.
pub type Clock = Arc<dyn Fn() -> Duration + Send + Sync>;

impl Default for ServeConfig {
    fn default() -> Self {
        let start = Instant::now();
        ServeConfig {
            http: SocketAddr::from(([127, 0, 0, 1], 8080)),
            zmq: None,
            data_dir: None,
            limits: Limits::default(),
            read_limits: None,
            token_file: None,
            tokens: None,
            tls: None,
            plaintext: false,
            open_to_network: false,
            allow_host: Vec::new(),
            allow_origin: Vec::new(),
            log: AccessLog::default(),
            clock: Arc::new(move || start.elapsed()),
        }
    }
}
