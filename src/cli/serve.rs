//! `iplw serve` and `iplw openapi`.

use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use iplw::access::parse_duration;
use iplw::error::{Error, Result};
use iplw::serve::{AccessLog, Limits, LogFormat, ServeConfig, openapi, serve_blocking};
use tracing::Level;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::prelude::*;

use super::common_options::{ThreadOptions, exit_with_stdin};
use super::json_events::JsonEvents;
use super::output;
use super::task_sources::{COMMON_OPTIONS, TaskSources};

/// Serve worlds over HTTP.
///
/// Serves worlds over HTTP, and optionally over ZeroMQ. Every family has a simulated and a real world: bowling-sim, bowling-real, ...
/// The documentation is at /docs, the OpenAPI document at /openapi.json.
///
/// By default the server listens on localhost without authentication. To listen elsewhere, create tokens first (`iplw token new`).
#[derive(clap::Args)]
pub struct Args {
    /// HTTP address; port 0 takes a free port, printed on the first line of standard output.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8080")]
    http: String,
    /// ZeroMQ address: tcp://127.0.0.1:5555 (port 0 or * takes a free one) or ipc:///path [default: off]
    #[arg(long, value_name = "ADDRESS")]
    zmq: Option<String>,
    /// Directory for jobs, worlds, policies and tokens [default: in memory]
    ///
    /// Only its owner may have access to it. Damaged records are reported and not served; see `iplw check` and `iplw backup`.
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// JSON file with limits that differ from the defaults in /v1/limits.
    #[arg(long, value_name = "FILE")]
    limits: Option<PathBuf>,
    /// Seconds after which an unused world of a client is deleted [default: 1800]
    #[arg(long)]
    idle: Option<u64>,
    /// Maximal number of worlds at a time [default: 4096]
    #[arg(long)]
    worlds: Option<usize>,
    /// Delete jobs with their data this long after they ended: 30d, 12h, 15m, 90s [default: keep all jobs]
    #[arg(long, value_name = "SPAN")]
    keep_jobs: Option<String>,
    /// Token file [default: that of the data directory; also $IPLW_TOKENS]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// PEM file with the server's certificate, then its chain; read again on SIGHUP [default: no TLS]
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// PEM file with the private key of the certificate.
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
    /// Allow tokens over unencrypted HTTP: a proxy or tunnel in front of the server encrypts.
    #[arg(long)]
    plaintext: bool,
    /// Disable authentication on all addresses: everyone who reaches the server has full access.
    #[arg(long)]
    open_to_network: bool,
    /// Additional host name of the server; may be repeated [default: localhost and its addresses]
    ///
    /// `*` allows any name, which disables the protection against DNS rebinding.
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<String>,
    /// Web origin allowed to send requests, such as https://lab.example; may be repeated.
    #[arg(long, value_name = "ORIGIN")]
    allow_origin: Vec<String>,
    /// Log requests and finished jobs to standard error: json or text [default: off]
    #[arg(long, value_name = "FORM")]
    log: Option<String>,
    /// Stop when standard input closes.
    #[arg(long, help_heading = COMMON_OPTIONS)]
    exit_with_stdin: bool,
    #[command(flatten)]
    families: TaskSources,
    #[command(flatten)]
    threads: ThreadOptions,
}

pub fn run(args: &Args) -> Result<()> {
    let Ok(http) = args.http.parse::<SocketAddr>() else {
        return Err(Error::input(
            "--http",
            format!("{:?}", args.http),
            "an address and port such as 127.0.0.1:8080",
        ));
    };
    let overrides = LimitOverrides {
        file: args.limits.clone(),
        idle: args.idle,
        worlds: args.worlds,
        keep_jobs: args.keep_jobs.clone(),
    };
    let limits = overrides.read()?;
    if args.exit_with_stdin {
        exit_with_stdin(0);
    }
    args.threads.install()?;
    args.families.load()?;
    let log = match &args.log {
        None => AccessLog::default(),
        Some(form) => AccessLog::new(LogFormat::from_name("--log", form)?, Arc::new(to_stderr)),
    };
    init_logging(args.log.as_deref() == Some("json"));
    serve_blocking(ServeConfig {
        http,
        zmq: args.zmq.clone(),
        data_dir: args.data_dir.clone(),
        limits,
        read_limits: Some(Arc::new(move || overrides.read())),
        log,
        token_file: args.token_file.clone(),
        tokens: environment_variable("IPLW_TOKENS")?,
        tls: args.tls_cert.clone().zip(args.tls_key.clone()),
        plaintext: args.plaintext,
        open_to_network: args.open_to_network,
        allow_host: args.allow_host.clone(),
        allow_origin: args.allow_origin.clone(),
        ..ServeConfig::default()
    })
}

/// The limits' file, and the options that override it.
struct LimitOverrides {
    file: Option<PathBuf>,
    idle: Option<u64>,
    worlds: Option<usize>,
    keep_jobs: Option<String>,
}

impl LimitOverrides {
    fn read(&self) -> Result<Limits> {
        let mut limits = self.file.as_deref().map_or_else(|| Ok(Limits::default()), Limits::read)?;
        if let Some(idle) = self.idle {
            limits.world_idle_seconds = iplw::error::check_range("--idle", idle as f64, 1.0, 1e9)?;
        }
        if let Some(worlds) = self.worlds {
            iplw::error::check_range("--worlds", worlds as f64, 4.0, 1e6)?;
            limits.worlds = worlds;
        }
        if let Some(span) = &self.keep_jobs {
            limits.job_kept_seconds = parse_duration("--keep-jobs", span)?.map(|s| s as f64);
        }
        Ok(limits)
    }
}

/// Logs events to stderr at the level of RUST_LOG, by default warnings, and reloads; as JSON if the log of requests is.
pub fn init_logging(json: bool) {
    let configured = std::env::var("RUST_LOG").ok().and_then(|text| text.parse::<Targets>().ok());
    let default = || Targets::new().with_default(Level::WARN).with_target("iplw::serve::reload", Level::INFO);
    let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
    let lines = if json { lines.with_ansi(false).event_format(JsonEvents).boxed() } else { lines.boxed() };
    tracing_subscriber::registry().with(lines).with(configured.unwrap_or_else(default)).init();
}

/// Writes a line at once, so that lines of other processes can't come in between.
pub fn to_stderr(line: &str) {
    let whole = [line.as_bytes(), b"\n"].concat();
    // A closed stderr doesn't stop the server.
    let _ = std::io::stderr().lock().write_all(&whole);
}

/// An environment variable, unless it is unset or blank.
pub fn environment_variable(name: &str) -> Result<Option<String>> {
    match std::env::var(name) {
        Ok(value) => Ok(Some(value).filter(|v| !v.trim().is_empty())),
        Err(std::env::VarError::NotPresent) => Ok(None),
        Err(e) => Err(Error::input(name, e, "text in UTF-8")),
    }
}

/// Prints the server's OpenAPI document.
pub fn print_openapi() -> Result<()> {
    output::print(&(openapi().trim_end().to_string() + "\n"))
}
