//! HTTP, ZeroMQ and MCP servers over sessions, jobs and policies: thin adapters without physics.
//!
//! | module | responsibility |
//! |---|---|
//! | `operations/` | handlers: functions over wire types, each with its declaration |
//! | `operation/` | how an operation is declared: request, extractors, response |
//! | `http/` | routes, middleware, connections and the OpenAPI document |
//! | `zmq/` | the same operations over ZeroMQ: connections, frames, ordering |
//! | `mcp/` | tools for language models over standard input and output; the only user of rmcp |
//! | `wire/` | request and response types; JSON and msgpack |
//! | `problem` | errors as RFC 9457 problem details |
//! | `state` `request_context` | application state; the view that one request has of it; work off the async threads |
//! | `maintenance` `reload` | startup, periodic tasks, shutdown; SIGHUP |
//! | `client` `scheduler` `fair_semaphore` `client_limiter` `execution_class` | fair sharing of the server between clients |
//! | `concealment` | hidden physics that only its owner sees |
//! | `bind_policy` | which addresses need tokens and encryption |
//! | `deadline` | a request's deadline and cancellation |
//! | `readiness` | whether the disk takes writes |
//! | `limits` | sizes, counts and timeouts |
//! | `metrics` `log` | counters and durations; one log line per request and job |
//! | `cache` | a bounded cache of expensive values |
//! | `memory` `memory_pressure` | allocator settings; whether memory is scarce |
//! | `config` `signal` | server configuration; stop signals |
//! | `fuzz` | entry points for fuzzing |
//!
//! Path of a request: `http/route` (or `zmq/peer`) makes an `OperationRequest`; the operation's declaration extracts the
//! handler's input (`JsonBody<StepIn>`) and calls the handler in `operations/world`, which steps a `session::World`. The
//! response is serialised as JSON or msgpack by the transport.
//!
//! [`serve`] runs until a stop signal; [`Server`] is the same for tests and other programs.

// A problem is built once per rejected request; boxing it everywhere would only hide it.
#![allow(clippy::result_large_err)]

mod bind_policy;
mod cache;
mod client;
mod client_limiter;
mod concealment;
mod config;
mod control_worlds;
mod deadline;
mod execution_class;
mod fair_semaphore;
#[doc(hidden)]
pub mod fuzz;
mod http;
mod limits;
mod log;
mod maintenance;
mod mcp;
mod memory;
mod memory_pressure;
mod metrics;
mod operation;
mod operations;
mod problem;
mod readiness;
mod reload;
mod request_context;
mod runtime;
mod scheduler;
mod signal;
mod state;
mod wire;
mod zmq;

use std::future::Future;
use std::net::SocketAddr;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use tokio::net::TcpListener;

use crate::error::{Error, Result};
use crate::thread_priority::lower;
pub use config::{Clock, ServeConfig};
pub use limits::Limits;
pub use log::{AccessLog, LogFormat, LogSink};
use maintenance::Maintenance;
pub use mcp::{McpConfig, mcp_blocking};
use operations::OPERATIONS;
use runtime::run_to_completion;
use signal::stop_signal;
use state::AppState;

/// A server that has bound its addresses and does not accept connections yet.
pub struct Server {
    shared: Arc<AppState>,
    listener: TcpListener,
    address: SocketAddr,
    zmq: Option<zmq::Endpoint>,
    origins: http::OriginPolicy,
    tls: Option<Arc<http::Tls>>,
}

/// Serves until SIGINT or SIGTERM. Once it listens, it prints `listening on http://HOST:PORT` to standard output, and with
/// ZeroMQ a second line `listening on tcp://HOST:PORT` (or `ipc://PATH`).
pub async fn serve(config: ServeConfig) -> Result<()> {
    // An error means that the pool exists already, with another number of threads.
    let _ = rayon::ThreadPoolBuilder::new().start_handler(|_| lower()).build_global();
    let signal = stop_signal()?;
    let server = Server::bind(config).await?;
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    let mut output = format!("listening on {}://{}\n", server.scheme(), server.address());
    if let Some(address) = server.zmq_address() {
        output += &format!("listening on {address}\n");
    }
    // A closed standard output does not stop the server.
    let _ = out.write_all(output.as_bytes()).and_then(|()| out.flush());
    drop(out);
    server.run(signal).await
}

/// [`serve`] on its own runtime; does not wait for work that ignores the stop signal.
pub fn serve_blocking(config: ServeConfig) -> Result<()> {
    run_to_completion(serve(config), Duration::from_secs(1))
}

/// The OpenAPI 3.1 document, pretty JSON with a newline at the end.
pub fn openapi() -> String {
    DOCUMENT.clone()
}

static DOCUMENT: LazyLock<String> = LazyLock::new(|| http::document(&OPERATIONS));

impl Server {
    /// Opens the store, creates the default worlds and binds the addresses.
    pub async fn bind(config: ServeConfig) -> Result<Server> {
        let unbound = |e: std::io::Error| Error::Io {
            path: config.http.to_string(),
            message: format!("cannot listen on this address: {e}; choose another"),
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
        let origins = http::OriginPolicy::new(address.ip(), &config.allow_host, &config.allow_origin);
        let zmq_at = zmq.as_ref().and_then(zmq::Endpoint::ip);
        let made = move || {
            let keyring = bind_policy::keyring(&config)?;
            bind_policy::check(&config, &keyring, address.ip(), zmq_at)?;
            maintenance::open(&config, keyring, &DOCUMENT)
        };
        let shared = tokio::task::spawn_blocking(made)
            .await
            .map_err(|e| Error::Failed(format!("the server could not be started: {e}")))??;
        Ok(Server { shared, listener, address, zmq, origins, tls })
    }

    /// The bound HTTP address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// `http` or `https`.
    pub fn scheme(&self) -> &'static str {
        if self.tls.is_some() { "https" } else { "http" }
    }

    /// The bound ZeroMQ address, if there is one.
    pub fn zmq_address(&self) -> Option<&str> {
        self.zmq.as_ref().map(zmq::Endpoint::address)
    }

    /// Serves until `stop` is ready, then finishes the requests in flight. Unfinished jobs are left to the next server on the
    /// same directory.
    pub async fn run(self, stop: impl Future<Output = ()> + Send + 'static) -> Result<()> {
        let Server { shared, listener, zmq, origins, tls, .. } = self;
        let maintenance = Maintenance::start(&shared);
        let state = shared.clone();
        let service = http::service(shared.clone(), &OPERATIONS, origins);
        let renewal = tokio::spawn(reload::on_hangup(shared.clone(), tls.clone()));
        let graceful = async move {
            stop.await;
            state.stopping.send_replace(true);
            // `stop` blocks until the jobs notice, so it runs off the async threads.
            tokio::task::spawn_blocking(move || state.jobs.stop(GRACE));
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
            // Clients that keep their connection open are not waited for.
            () = late => {}
        }
        renewal.abort();
        maintenance.end(GRACE).await;
        Ok(())
    }
}

/// Time that requests in flight have to finish after the stop signal.
const GRACE: Duration = Duration::from_secs(5);
