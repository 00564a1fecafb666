//! Counters, and all of them in Prometheus' text format.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::session::Kind;
use crate::store::JobState;

/// What is counted while the server runs.
#[derive(Default)]
pub struct Metrics {
    requests: Mutex<Requests>,
    rollouts: AtomicU64,
    /// Valid attempts in simulated and in real worlds.
    interactions: [AtomicU64; 2],
}

/// By method, route and status; ZeroMQ counts as a method, its operations as routes.
type Requests = BTreeMap<&'static str, BTreeMap<String, BTreeMap<u16, u64>>>;

impl Metrics {
    /// A request was answered.
    pub fn answered(&self, method: &str, route: &str, status: u16) {
        let method = METHODS.into_iter().find(|m| *m == method).unwrap_or("other");
        let mut requests = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        let routes = requests.entry(method).or_default();
        match routes.get_mut(route) {
            Some(counts) => *counts.entry(status).or_default() += 1,
            None => drop(routes.insert(route.into(), BTreeMap::from([(status, 1)]))),
        }
    }

    /// `valid` attempts were made in a world of this kind.
    pub fn attempted(&self, kind: Kind, valid: u64) {
        self.rollouts.fetch_add(valid, Ordering::Relaxed);
        self.interactions[usize::from(kind == Kind::Real)].fetch_add(valid, Ordering::Relaxed);
    }

    /// Rollouts were simulated in a job, in no client's world.
    pub fn simulated(&self, rollouts: u64) {
        self.rollouts.fetch_add(rollouts, Ordering::Relaxed);
    }

    /// Everything, in Prometheus' text format.
    pub fn text(&self, gauges: &Gauges) -> String {
        let mut out = String::new();
        let requests = self.requests.lock().unwrap_or_else(PoisonError::into_inner).clone();
        head(&mut out, "iplw_requests_total", "counter", "Requests answered.");
        let requests: Vec<(&str, &str, u16, u64)> = requests
            .iter()
            .flat_map(|(method, routes)| {
                routes.iter().map(move |(route, counts)| (*method, route.as_str(), counts))
            })
            .flat_map(|(method, route, counts)| {
                counts.iter().map(move |(status, n)| (method, route, *status, *n))
            })
            .collect();
        for (method, route, status, n) in &requests {
            line(
                &mut out,
                "iplw_requests_total",
                &[("method", method), ("route", route), ("status", &status.to_string())],
                *n,
            );
        }
        head(&mut out, "iplw_errors_total", "counter", "Requests answered with a problem, by its class.");
        for (class, range) in [("4xx", 400..500), ("5xx", 500..600)] {
            let n = requests.iter().filter(|(_, _, status, _)| range.contains(status)).map(|(.., n)| n).sum();
            line(&mut out, "iplw_errors_total", &[("class", class)], n);
        }
        head(&mut out, "iplw_worlds", "gauge", "Worlds there are.");
        for (kind, n) in [Kind::Sim, Kind::Real].into_iter().zip(gauges.worlds) {
            line(&mut out, "iplw_worlds", &[("kind", kind.name())], n);
        }
        head(&mut out, "iplw_interactions_total", "counter", "Valid attempts in worlds.");
        for (kind, n) in [Kind::Sim, Kind::Real].into_iter().zip(&self.interactions) {
            line(&mut out, "iplw_interactions_total", &[("kind", kind.name())], n.load(Ordering::Relaxed));
        }
        head(&mut out, "iplw_rollouts_total", "counter", "Rollouts simulated, those of ended jobs included.");
        line(&mut out, "iplw_rollouts_total", &[], self.rollouts.load(Ordering::Relaxed));
        head(&mut out, "iplw_jobs", "gauge", "Jobs by state.");
        for state in JobState::ALL {
            line(
                &mut out,
                "iplw_jobs",
                &[("state", state.name())],
                gauges.jobs.get(state.name()).copied().unwrap_or(0),
            );
        }
        out
    }
}

/// What there is at the moment.
pub struct Gauges {
    /// Simulated and real worlds.
    pub worlds: [u64; 2],
    /// Jobs by state.
    pub jobs: BTreeMap<String, u64>,
}

const METHODS: [&str; 8] = ["GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "ZMQ"];

fn head(out: &mut String, name: &str, kind: &str, help: &str) {
    let _ = writeln!(out, "# HELP {name} {help}\n# TYPE {name} {kind}");
}

fn line(out: &mut String, name: &str, labels: &[(&str, &str)], value: u64) {
    let labels: Vec<String> = labels.iter().map(|(k, v)| format!("{k}=\"{v}\"")).collect();
    let labels = if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) };
    let _ = writeln!(out, "{name}{labels} {value}");
}
