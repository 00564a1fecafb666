//! Every limit of a server, with its default and the response beyond it.
//!
//! `iplw serve --limits FILE` reads a JSON file of limits (absent ones keep their default); `GET /v1/limits` returns them.

use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::error::{Error, Result, check_count, check_range};
use crate::json;
use crate::serve::wire::BinaryArrays;
use crate::session::RequestLimits;

/// Limits of a server: sizes, counts and timeouts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Maximum duration of a request, s; a client may choose less (`X-Deadline`, over ZeroMQ `deadline`). Beyond: 503 `deadline`.
    pub request_seconds: f64,
    /// Maximum time to receive the head of a request, s. Beyond: the connection is closed.
    pub header_seconds: f64,
    /// Maximum time to receive a body, s. Beyond: 408 `slow`.
    pub body_seconds: f64,
    /// Maximum idle time of a connection between requests, s. Beyond: the connection is closed.
    pub idle_seconds: f64,
    /// Maximum time in which a client reads nothing of its response, s. Beyond: the connection is closed.
    pub write_seconds: f64,
    /// Maximum HTTP connections. Beyond: the connection that has been idle longest is closed; if all are busy, the new one.
    pub connections: usize,
    /// Maximum connections of one client (its token, or its address without a token) over HTTP, and as many over ZeroMQ. Beyond:
    /// its connection that has been idle longest is closed; if all are busy, or over ZeroMQ, the new one.
    pub client_connections: usize,
    /// Maximum number of bodies times time steps that a request may simulate. Beyond: 413 `too-large`.
    pub body_steps: u64,
    /// Maximum number of actions or worlds in a request. Beyond: 413 `too-large`.
    pub actions: usize,
    /// Maximum number of sampled body states in a response. Beyond: 413 `too-large`.
    pub samples: u64,
    /// Maximum memory of a diagnosis, posterior or likelihood, estimated before it starts, bytes. Beyond: 413 `too-large`.
    pub memory_bytes: u64,
    /// Maximum number of worlds. Beyond: 429 `capacity`.
    pub worlds: usize,
    /// Maximum number of worlds of one token. Beyond: 429 `capacity`.
    pub owner_worlds: usize,
    /// Time after which an unused world of a client is removed, s.
    pub world_idle_seconds: f64,
    /// Number of jobs that run at a time; the others wait. A client's first job does not wait for those of other clients: it runs
    /// beside them and shares the cores, up to 16 jobs in all.
    pub jobs_running: usize,
    /// Maximum number of waiting jobs. Beyond: 429 `capacity`.
    pub jobs_waiting: usize,
    /// Maximum number of waiting jobs of one client. Beyond: 429 `capacity`.
    pub owner_jobs: usize,
    /// Maximum size of what is stored for one token (worlds, jobs, policies), bytes. Beyond: 429 `capacity`.
    pub owner_bytes: u64,
    /// Maximum size of the request bodies of one client that the server holds at a time, bytes. Beyond: 429 `busy`.
    pub client_body_bytes: u64,
    /// Maximum size of all request bodies that the server holds at a time, bytes. Beyond: 429 `busy`.
    pub body_bytes: u64,
    /// Maximum computing time of a job, s, without the time it waits for results; unlimited if absent. Beyond: it fails with `deadline`.
    pub job_seconds: Option<f64>,
    /// Time after which an ended job and its data are removed, s; never if absent.
    pub job_kept_seconds: Option<f64>,
}

impl Default for Limits {
    fn default() -> Limits {
        let most = RequestLimits::STANDARD;
        Limits {
            // The project's clients wait for 30 s.
            request_seconds: 30.0,
            header_seconds: 10.0,
            // 16 MiB at 2 Mbit/s.
            body_seconds: 60.0,
            idle_seconds: 120.0,
            write_seconds: 60.0,
            connections: 4096,
            client_connections: 1024,
            body_steps: most.body_steps,
            actions: most.actions,
            samples: most.samples,
            memory_bytes: most.memory_bytes,
            worlds: 4096,
            owner_worlds: 2048,
            world_idle_seconds: 1800.0,
            jobs_running: 2,
            jobs_waiting: 64,
            owner_jobs: 48,
            owner_bytes: 2 << 30,
            client_body_bytes: 128 << 20,
            body_bytes: 512 << 20,
            job_seconds: None,
            job_kept_seconds: None,
        }
    }
}

impl BinaryArrays for Limits {}

impl Limits {
    /// Reads a file of limits.
    pub fn read(path: &Path) -> Result<Limits> {
        let text = std::fs::read_to_string(path).map_err(|e| {
            let allowed = "a JSON file of limits such as {\"worlds\": 100}";
            Error::input("--limits", format!("{} ({e})", path.display()), allowed)
        })?;
        Limits::parse(&text).map_err(|e| e.in_file(format!("--limits {}", path.display())))
    }

    /// Parses a file of limits.
    pub fn parse(text: &str) -> Result<Limits> {
        // As a map first: serde would also accept a list.
        let fields: Map<String, Value> = json::parse(text)?;
        let limits: Limits = json::from_value(Value::Object(fields))?;
        limits.validate()?;
        Ok(limits)
    }

    /// Errors name the invalid limit.
    pub fn validate(&self) -> Result<()> {
        for (field, seconds) in [
            ("request_seconds", self.request_seconds),
            ("header_seconds", self.header_seconds),
            ("body_seconds", self.body_seconds),
            ("idle_seconds", self.idle_seconds),
            ("write_seconds", self.write_seconds),
        ] {
            check_range(field, seconds, 0.1, 86_400.0)?;
        }
        check_range("world_idle_seconds", self.world_idle_seconds, 1.0, 1e9)?;
        self.job_seconds.map_or(Ok(0.0), |s| check_range("job_seconds", s, 1.0, 1e9))?;
        // At most a token's maximum lifetime: 100 years.
        self.job_kept_seconds
            .map_or(Ok(0.0), |s| check_range("job_kept_seconds", s, 1.0, 3_153_600_000.0))?;
        check_count("connections", self.connections as u64, 8, 1_000_000)?;
        check_count("client_connections", self.client_connections as u64, 4, 1_000_000)?;
        check_count("body_steps", self.body_steps, 10_000, 10_000_000_000)?;
        check_count("actions", self.actions as u64, 1, 65_536)?;
        check_count("samples", self.samples, 10_000, 100_000_000)?;
        check_count("memory_bytes", self.memory_bytes, 1 << 20, 1 << 50)?;
        check_count("worlds", self.worlds as u64, 4, 1_000_000)?;
        check_count("jobs_running", self.jobs_running as u64, 1, 64)?;
        check_count("jobs_waiting", self.jobs_waiting as u64, 1, 100_000)?;
        check_count("owner_worlds", self.owner_worlds as u64, 1, 1_000_000)?;
        check_count("owner_jobs", self.owner_jobs as u64, 1, 100_000)?;
        check_count("owner_bytes", self.owner_bytes, 1 << 20, 1 << 50)?;
        check_count("client_body_bytes", self.client_body_bytes, 16 << 20, 1 << 40)?;
        check_count("body_bytes", self.body_bytes, 16 << 20, 1 << 40)
    }

    /// Limits of one request.
    pub fn request_limits(&self) -> RequestLimits {
        RequestLimits {
            actions: self.actions,
            samples: self.samples,
            body_steps: self.body_steps,
            memory_bytes: self.memory_bytes,
        }
    }

    /// As a duration; [`Limits::validate`] has checked the range.
    pub fn duration(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// docs/reference/limits.md lists every limit with its default.
    #[test]
    fn every_limit_is_documented_with_its_default() {
        let page = include_str!("../../docs/reference/limits.md");
        let limits = serde_json::to_value(Limits::default()).unwrap();
        for (name, value) in limits.as_object().unwrap() {
            let row = page.lines().find(|l| l.starts_with(&format!("| `{name}`"))).expect(name);
            let documented = row.split('|').nth(2).unwrap().trim();
            let default = value.as_f64().map_or("null, no end".into(), |v| v.to_string());
            assert_eq!(documented, default, "{name}");
        }
    }

    #[test]
    fn reads_overrides_and_names_invalid_limit() {
        let place = tempfile::tempdir().unwrap();
        let read = |text: &str| {
            let path = place.path().join("limits.json");
            std::fs::write(&path, text).unwrap();
            Limits::read(&path)
        };
        Limits::default().validate().unwrap();
        assert_eq!(read("{}").unwrap(), Limits::default());
        assert_eq!(read("{\"worlds\": 9}").unwrap(), Limits { worlds: 9, ..Limits::default() });
        for (bad, named) in [
            ("{\"worlds\": 1}", "`worlds` is 1"),
            ("{\"request_seconds\": 0}", "`request_seconds`"),
            ("{\"header_seconds\": 1e99}", "`header_seconds`"),
            ("{\"word\": 1}", "word"),
            ("{\"word\": 1}", "`header_seconds`"),
            ("{\"worlds\": \"many\"}", "`worlds`"),
            ("{\"job_seconds\": -1}", "`job_seconds`"),
            ("[]", "limits.json"),
        ] {
            let message = read(bad).unwrap_err().to_string();
            let whole = message.starts_with("--limits ")
                && message.contains("limits.json")
                && message.contains("allowed: ");
            assert!(message.contains(named) && whole, "{bad}: {message}");
        }
        let missing = Limits::read(&place.path().join("none.json")).unwrap_err().to_string();
        assert!(missing.contains("`--limits`") && missing.contains("none.json"), "{missing}");
    }
}
