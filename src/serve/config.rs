//! How a server is run.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::limits::Limits;
use super::log::Log;

/// How a server is run.
#[derive(Clone)]
pub struct ServeConfig {
    /// Address to listen on; port 0 takes a free one.
    pub http: SocketAddr,
    /// Where to listen for ZeroMQ besides: `tcp://HOST:PORT` or `ipc://PATH`.
    pub zmq: Option<String>,
    /// Where jobs, worlds and policies are kept; in memory if absent.
    pub data_dir: Option<PathBuf>,
    /// What it takes, and for how long.
    pub limits: Limits,
    /// Tokens beside those of the data directory: a file of them.
    pub token_file: Option<PathBuf>,
    /// The same: rows of such a file as JSON.
    pub tokens: Option<String>,
    /// Certificates and their key, PEM: HTTP is encrypted.
    pub tls: Option<(PathBuf, PathBuf)>,
    /// Whether tokens may cross a network in clear, because something in front encrypts.
    pub plaintext: bool,
    /// Whether anybody on the network may do anything.
    pub open_to_network: bool,
    /// Names that clients may call the server by besides its addresses.
    pub allow_host: Vec<String>,
    /// Origins of pages that may ask.
    pub allow_origin: Vec<String>,
    /// Where a line goes for each request and each job that ends.
    pub log: Log,
    /// What time it is.
    pub clock: Clock,
}

/// Seconds since anywhere; counts up.
pub type Clock = Arc<dyn Fn() -> Duration + Send + Sync>;

impl Default for ServeConfig {
    fn default() -> Self {
        let start = Instant::now();
        ServeConfig {
            http: SocketAddr::from(([127, 0, 0, 1], 8080)),
            zmq: None,
            data_dir: None,
            limits: Limits::default(),
            token_file: None,
            tokens: None,
            tls: None,
            plaintext: false,
            open_to_network: false,
            allow_host: Vec::new(),
            allow_origin: Vec::new(),
            log: Log::default(),
            clock: Arc::new(move || start.elapsed()),
        }
    }
}
