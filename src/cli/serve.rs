//! `iplw serve` and `iplw openapi`.

use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use iplw::access::days;
use iplw::error::{Error, Result};
use iplw::serve::{Limits, Log, LogForm, ServeConfig, openapi, serve_blocking};
use tracing_subscriber::filter::Targets;
use tracing_subscriber::prelude::*;

use super::computing::{Threads, exit_with_stdin};
use super::output;
use super::own::OwnFamilies;

/// Worlds over HTTP, and over ZeroMQ if asked. A simulated and a real one of every family are ready at once: bowling-sim, bowling-real, ...
/// Documentation is served at /docs, the OpenAPI document at /openapi.json.
#[derive(clap::Args)]
pub struct Args {
    /// Address to listen on; port 0 takes a free one, printed on the first line of standard output.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8080")]
    http: String,
    /// Also listen for ZeroMQ: tcp://127.0.0.1:5555 (port 0 or * takes a free one, printed on the second line) or
    /// ipc:///path/of/a/socket.
    #[arg(long, value_name = "ADDRESS")]
    zmq: Option<String>,
    /// Directory for jobs, worlds, policies and tokens; without it they last as long as the server. Nobody else may read it.
    /// What is damaged in it is named and not served: `iplw check`, `iplw backup`, `iplw restore`.
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// Limits other than the usual ones: a JSON file of some of those that /v1/limits shows.
    #[arg(long, value_name = "FILE")]
    limits: Option<PathBuf>,
    /// Seconds after which a world that a client made and no longer uses goes [default: 1800]
    #[arg(long)]
    idle: Option<u64>,
    /// Most worlds at a time [default: 4096]
    #[arg(long)]
    worlds: Option<usize>,
    /// Forget jobs, with all that was measured for them and left by them, so long after they ended: 30d, 12h, 15m, 90s. All are
    /// kept, if nothing is said.
    #[arg(long, value_name = "SPAN")]
    keep_jobs: Option<String>,
    /// Tokens of a file instead of the data directory's (`iplw token new NAME --may act --token-file FILE`). Rows of
    /// such a file may come in the environment variable IPLW_TOKENS as well.
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Encrypt HTTP: a PEM file of certificates, the server's own first. Read again on SIGHUP.
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// The private key of the first certificate, PEM.
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
    /// Let tokens cross the network in clear: something in front of the server (a proxy, a tunnel) encrypts.
    #[arg(long)]
    plaintext: bool,
    /// Let anybody who can reach the server do anything.
    #[arg(long)]
    open_to_network: bool,
    /// A name that clients call the server by, besides localhost and its addresses; may be given several times. `*` is
    /// any, which gives up what protects from pages that turn their name into this address.
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<String>,
    /// The origin of pages that may ask, such as https://lab.example; may be given several times.
    #[arg(long, value_name = "ORIGIN")]
    allow_origin: Vec<String>,
    /// Write a line for each request and each job that ends to standard error: json or text.
    #[arg(long, value_name = "FORM")]
    log: Option<String>,
    /// Stop when standard input closes: the server ends with the program that started it.
    #[arg(long)]
    exit_with_stdin: bool,
    #[command(flatten)]
    families: OwnFamilies,
    #[command(flatten)]
    threads: Threads,
}

pub fn run(args: &Args) -> Result<()> {
    let Ok(http) = args.http.parse::<SocketAddr>() else {
        return Err(Error::input(
            "--http",
            format!("{:?}", args.http),
            "an address and port such as 127.0.0.1:8080",
        ));
    };
    let mut limits = args.limits.as_deref().map_or_else(|| Ok(Limits::default()), Limits::read)?;
    if let Some(idle) = args.idle {
        limits.world_idle_seconds = iplw::error::within("--idle", idle as f64, 1.0, 1e9)?;
    }
    if let Some(worlds) = args.worlds {
        iplw::error::within("--worlds", worlds as f64, 4.0, 1e6)?;
        limits.worlds = worlds;
    }
    if let Some(span) = &args.keep_jobs {
        limits.job_kept_seconds = days("--keep-jobs", span)?.map(|s| s as f64);
    }
    if args.exit_with_stdin {
        exit_with_stdin(0);
    }
    args.threads.take()?;
    args.families.take()?;
    let log = match &args.log {
        None => Log::default(),
        Some(form) => Log::new(LogForm::from_name("--log", form)?, Arc::new(to_stderr)),
    };
    notices();
    serve_blocking(ServeConfig {
        http,
        zmq: args.zmq.clone(),
        data_dir: args.data_dir.clone(),
        limits,
        log,
        token_file: args.token_file.clone(),
        tokens: environment("IPLW_TOKENS")?,
        tls: args.tls_cert.clone().zip(args.tls_key.clone()),
        plaintext: args.plaintext,
        open_to_network: args.open_to_network,
        allow_host: args.allow_host.clone(),
        allow_origin: args.allow_origin.clone(),
        ..ServeConfig::default()
    })
}

/// What a server notices goes to stderr; RUST_LOG says how much of it.
pub fn notices() {
    let asked = std::env::var("RUST_LOG").ok().and_then(|text| text.parse::<Targets>().ok());
    let filter = asked.unwrap_or_else(|| Targets::new().with_default(tracing::Level::WARN));
    let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
    tracing_subscriber::registry().with(lines).with(filter).init();
}

/// A line in one piece: in two, another process's could come between them.
pub fn to_stderr(line: &str) {
    let whole = [line.as_bytes(), b"\n"].concat();
    // Nobody reading it is no reason not to serve.
    let _ = std::io::stderr().lock().write_all(&whole);
}

/// A variable of the environment, if it is set to something.
pub fn environment(name: &str) -> Result<Option<String>> {
    match std::env::var(name) {
        Ok(value) => Ok(Some(value).filter(|v| !v.trim().is_empty())),
        Err(std::env::VarError::NotPresent) => Ok(None),
        Err(e) => Err(Error::input(name, e, "text in UTF-8")),
    }
}

/// Prints the OpenAPI document that the server serves.
pub fn print_openapi() -> Result<()> {
    output::print(&(openapi().trim_end().to_string() + "\n"))
}
