//! HTTP, ZeroMQ and MCP around the sessions, jobs and policies: thin adapters that know no physics.
//!
//! | file | what it does |
//! |---|---|
//! | `operations/` | what a client can ask for: functions over wire structs, each with its declaration |
//! | `operation/` | how an operation is declared, and what its function takes and gives |
//! | `http/` | routes and the OpenAPI document, from the declarations; bodies and headers |
//! | `zmq/` | the same over ZeroMQ: connections, frames, order |
//! | `mcp/` | tools for language models over standard input and output: a few operations each; sole home of rmcp |
//! | `wire/` | JSON and msgpack in and out |
//! | `problem` | errors as RFC 9457 |
//! | `shared` `app` | what requests share, and what one of them sees of it; work runs off the async threads |
//! | `upkeep` | how a server is opened, kept and brought to its end |
//! | `client` `fair` `gate` `crowd` `weight` | whom the server shares itself out between, and how |
//! | `exposure` | who could reach the server, and what is asked for before they can |
//! | `leave` | how long a request may go on |
//! | `limits` | what is taken, and for how long |
//! | `metrics` `log` | what happened: counters and times, a line for each request and job |
//! | `prepared` | what takes long to prepare and is asked again and again |
//! | `memory` | what the allocator keeps, and when it gives back |
//! | `config` `signal` | how a server is run, and told to stop |
//! | `fuzz` | what fuzzing reaches of all this |
//!
//! An action on its way: `http/route` (or `zmq/peer`) makes an `Asked` of what was sent; the operation's declaration
//! reads its input from it (`Body<StepIn>`) and calls the function beside it (`operations/world`), which steps a
//! `session::World`; the answer becomes JSON or msgpack where it came in.
//!
//! [`serve`] runs until the process is told to stop; [`Server`] is the same for tests and other programs.

// A problem is made once per refused request; boxing it everywhere would only hide it.
#![allow(clippy::result_large_err)]

mod app;
mod client;
mod config;
mod crowd;
mod exposure;
mod fair;
#[doc(hidden)]
pub mod fuzz;
mod gate;
mod http;
mod leave;
mod limits;
mod log;
mod mcp;
mod memory;
mod metrics;
mod operation;
mod operations;
mod prepared;
mod problem;
mod runtime;
mod shared;
mod signal;
mod upkeep;
mod weight;
mod wire;
mod zmq;

use std::future::Future;
use std::net::SocketAddr;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use tokio::net::TcpListener;

use crate::error::{Error, Result};
pub use config::{Clock, ServeConfig};
pub use limits::Limits;
pub use log::{Log, LogForm, Sink};
pub use mcp::{McpConfig, mcp_blocking};
use operations::OPERATIONS;
use runtime::run_to_end;
use shared::Shared;
use signal::stop_signal;
use upkeep::Upkeep;

/// A server that listens and does not answer yet.
pub struct Server {
    shared: Arc<Shared>,
    listener: TcpListener,
    address: SocketAddr,
    zmq: Option<zmq::Endpoint>,
    callers: http::Callers,
    tls: Option<Arc<http::Tls>>,
}

/// Serves until SIGINT or SIGTERM. Once it listens, `listening on http://HOST:PORT` stands alone on a line of
/// standard output, and on the next one `listening on tcp://HOST:PORT` (or `ipc://PATH`) if there is ZeroMQ too.
pub async fn serve(config: ServeConfig) -> Result<()> {
    let signal = stop_signal()?;
    let server = Server::bind(config).await?;
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    let mut told = format!("listening on {}://{}\n", server.scheme(), server.address());
    if let Some(address) = server.zmq_address() {
        told += &format!("listening on {address}\n");
    }
    // Nobody reading standard output is no reason not to serve.
    let _ = out.write_all(told.as_bytes()).and_then(|()| out.flush());
    drop(out);
    server.run(signal).await
}

/// [`serve`] on a runtime of its own; returns without waiting for work that does not notice the stop.
pub fn serve_blocking(config: ServeConfig) -> Result<()> {
    run_to_end(serve(config), Duration::from_secs(1))
}

/// The OpenAPI 3.1 document, pretty JSON with a newline at the end.
pub fn openapi() -> String {
    DOCUMENT.clone()
}

static DOCUMENT: LazyLock<String> = LazyLock::new(|| http::document(&OPERATIONS));

impl Server {
    /// Opens the store, makes the default worlds and listens.
    pub async fn bind(config: ServeConfig) -> Result<Server> {
        let unbound = |e: std::io::Error| Error::Io {
            path: config.http.to_string(),
            message: format!("cannot listen there: {e}; give another address"),
        };
        let listener = TcpListener::bind(config.http).await.map_err(unbound)?;
        let address = listener.local_addr().map_err(unbound)?;
        let zmq = match &config.zmq {
            Some(address) => Some(zmq::Endpoint::bind(address).await?),
            None => None,
        };
        config.limits.validate()?;
        let files = config.tls.as_ref();
        let tls = files.map(|(cert, key)| http::Tls::read(cert, key)).transpose()?.map(Arc::new);
        let callers = http::Callers::new(address.ip(), &config.allow_host, &config.allow_origin);
        let zmq_at = zmq.as_ref().and_then(zmq::Endpoint::ip);
        let made = move || {
            let keyring = exposure::keyring(&config)?;
            exposure::allowed(&config, &keyring, address.ip(), zmq_at)?;
            upkeep::open(&config, keyring, &DOCUMENT)
        };
        let shared = tokio::task::spawn_blocking(made)
            .await
            .map_err(|e| Error::Failed(format!("the server could not be made: {e}")))??;
        Ok(Server { shared, listener, address, zmq, callers, tls })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// `http` or `https`.
    pub fn scheme(&self) -> &'static str {
        if self.tls.is_some() { "https" } else { "http" }
    }

    /// Where it listens for ZeroMQ, if it does.
    pub fn zmq_address(&self) -> Option<&str> {
        self.zmq.as_ref().map(zmq::Endpoint::address)
    }

    /// Answers until `stop` is ready; then ends what it is doing. Jobs it has not finished are left to the next
    /// server on the same directory.
    pub async fn run(self, stop: impl Future<Output = ()> + Send + 'static) -> Result<()> {
        let Server { shared, listener, zmq, callers, tls, .. } = self;
        let upkeep = Upkeep::start(&shared);
        let told = shared.clone();
        let service = http::service(shared.clone(), &OPERATIONS, callers);
        let renewal = tokio::spawn(renew(tls.clone()));
        let graceful = async move {
            stop.await;
            told.stopping.send_replace(true);
            // Off the async threads: waits for jobs to notice.
            tokio::task::spawn_blocking(move || told.jobs.stop(GRACE));
        };
        let mut ended = shared.stopping.subscribe();
        let late = async move {
            let _ = ended.wait_for(|s| *s).await;
            tokio::time::sleep(GRACE).await;
        };
        let http = http::serve(listener, service, shared.clone(), tls);
        let zmq = async {
            if let Some(endpoint) = zmq {
                endpoint.run(shared.clone()).await;
            }
        };
        tokio::spawn(graceful);
        tokio::select! {
            ((), ()) = async { tokio::join!(http, zmq) } => {}
            // Clients that do not hang up are not waited for.
            () = late => {}
        }
        renewal.abort();
        upkeep.end(GRACE).await;
        Ok(())
    }
}

/// How long answers under way may take once the server is told to stop.
const GRACE: Duration = Duration::from_secs(5);

/// Reads the certificate again whenever SIGHUP says that it was renewed.
#[cfg(unix)]
async fn renew(tls: Option<Arc<http::Tls>>) {
    use tokio::signal::unix::{SignalKind, signal};
    let Some(tls) = tls else { return };
    let Ok(mut renewed) = signal(SignalKind::hangup()) else { return };
    while renewed.recv().await.is_some() {
        match tls.reload() {
            Ok(()) => tracing::info!("the certificate was read again"),
            Err(e) => tracing::error!("the certificate cannot be read again, the one before stays: {e}"),
        }
    }
}

/// There is no such signal.
#[cfg(not(unix))]
async fn renew(_: Option<Arc<http::Tls>>) {}
