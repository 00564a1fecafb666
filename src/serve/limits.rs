//! Every limit of a server in one place: what it is, what it is if nobody says, and what is answered beyond it.
//!
//! `iplw serve --limits FILE` reads a file of them (JSON; what is absent stays), `GET /v1/limits` shows them.

use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::error::{Error, Result, within};
use crate::json;
use crate::serve::wire::Bulk;
use crate::session::RequestLimits;

/// What a server takes, and for how long.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Longest a request may take, s; a client may ask for less (`X-Deadline`, over ZeroMQ `deadline`). Beyond: 503 `deadline`.
    pub request_seconds: f64,
    /// Longest the head of a request may take to come, s. Beyond: hung up on.
    pub header_seconds: f64,
    /// Longest a body may take to come, s. Beyond: 408 `slow`.
    pub body_seconds: f64,
    /// Longest a connection may be silent between requests, s. Beyond: hung up on.
    pub idle_seconds: f64,
    /// Longest a client may take nothing of its answer, s. Beyond: hung up on.
    pub write_seconds: f64,
    /// Most connections over HTTP. Beyond: the one that has waited longest for a request is hung up on; where all are busy,
    /// the new one.
    pub connections: usize,
    /// Most bodies times time steps that a request may simulate. Beyond: 413 `too-large`.
    pub body_steps: u64,
    /// Most actions, or worlds, in a request. Beyond: 413 `too-large`.
    pub actions: usize,
    /// Most sampled body states in an answer. Beyond: 413 `too-large`.
    pub samples: u64,
    /// Most worlds. Beyond: 429 `capacity`.
    pub worlds: usize,
    /// How long a world that a client made may go unused, s. Then it goes.
    pub world_idle_seconds: f64,
    /// Jobs that run at a time; the others wait.
    pub jobs_running: usize,
    /// Most jobs that wait. Beyond: 429 `capacity`.
    pub jobs_waiting: usize,
    /// Longest a job may compute, s, waiting for answers not counted; without end, if absent. Beyond: it fails with `deadline`.
    pub job_seconds: Option<f64>,
}

impl Default for Limits {
    fn default() -> Limits {
        let most = RequestLimits::STANDARD;
        Limits {
            // A client of ours waits for 30 s.
            request_seconds: 30.0,
            header_seconds: 10.0,
            // 16 MiB at 2 Mbit/s.
            body_seconds: 60.0,
            idle_seconds: 120.0,
            write_seconds: 60.0,
            connections: 4096,
            body_steps: most.body_steps,
            actions: most.actions,
            samples: most.samples,
            worlds: 4096,
            world_idle_seconds: 1800.0,
            jobs_running: 2,
            jobs_waiting: 64,
            job_seconds: None,
        }
    }
}

impl Bulk for Limits {}

impl Limits {
    /// Those of a file.
    pub fn read(path: &Path) -> Result<Limits> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
        Limits::parse(&text).map_err(|e| e.at(path.display()))
    }

    /// Those of such a file's text.
    pub fn parse(text: &str) -> Result<Limits> {
        // As fields by name, or else a list would do.
        let fields: Map<String, Value> = json::parse(text)?;
        let limits: Limits = json::from_value(Value::Object(fields))?;
        limits.validate()?;
        Ok(limits)
    }

    /// Errors name what cannot be.
    pub fn validate(&self) -> Result<()> {
        for (field, seconds) in [
            ("request_seconds", self.request_seconds),
            ("header_seconds", self.header_seconds),
            ("body_seconds", self.body_seconds),
            ("idle_seconds", self.idle_seconds),
            ("write_seconds", self.write_seconds),
        ] {
            within(field, seconds, 0.1, 86_400.0)?;
        }
        within("world_idle_seconds", self.world_idle_seconds, 1.0, 1e9)?;
        self.job_seconds.map_or(Ok(0.0), |s| within("job_seconds", s, 1.0, 1e9))?;
        let whole = |field: &str, value: u64, low: u64, high: u64| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            Err(Error::input(field, value, format!("a whole number from {low} to {high}")))
        };
        whole("connections", self.connections as u64, 8, 1_000_000)?;
        whole("body_steps", self.body_steps, 10_000, 10_000_000_000)?;
        whole("actions", self.actions as u64, 1, 65_536)?;
        whole("samples", self.samples, 10_000, 100_000_000)?;
        whole("worlds", self.worlds as u64, 4, 1_000_000)?;
        whole("jobs_running", self.jobs_running as u64, 1, 64)?;
        whole("jobs_waiting", self.jobs_waiting as u64, 1, 100_000)
    }

    /// What one request may cost.
    pub fn of_request(&self) -> RequestLimits {
        RequestLimits { actions: self.actions, samples: self.samples, body_steps: self.body_steps }
    }

    /// As a span; [`Limits::validate`] has seen that it is one.
    pub fn span(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Its page names every limit with its default, in the row of the table that it begins.
    #[test]
    fn every_limit_is_documented_with_its_default() {
        let page = include_str!("../../docs/limits.md");
        let limits = serde_json::to_value(Limits::default()).unwrap();
        for (name, value) in limits.as_object().unwrap() {
            let row = page.lines().find(|l| l.starts_with(&format!("| `{name}`"))).expect(name);
            let told = row.split('|').nth(2).unwrap().trim();
            let default = value.as_f64().map_or("null, no end".into(), |v| v.to_string());
            assert_eq!(told, default, "{name}");
        }
    }

    #[test]
    fn a_file_says_what_differs_and_what_cannot_be_is_named() {
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
            ("{\"job_seconds\": -1}", "`job_seconds`"),
            ("[]", "limits.json"),
        ] {
            let said = read(bad).unwrap_err().to_string();
            assert!(said.contains(named) && said.contains("limits.json"), "{bad}: {said}");
        }
    }
}
