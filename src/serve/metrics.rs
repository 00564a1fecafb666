//! Counters, gauges and histograms in Prometheus' text format.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::session::WorldKind;
use crate::store::JobState;

/// Counters and histograms of the running server.
#[derive(Default)]
pub struct Metrics {
    requests: Mutex<RequestCounts>,
    durations: Mutex<BTreeMap<(&'static str, &'static str, &'static str), Histogram>>,
    rollouts: AtomicU64,
    /// Time steps simulated in worlds.
    steps: AtomicU64,
    /// Valid attempts in simulated and in real worlds.
    interactions: [AtomicU64; 2],
}

/// Upper bounds of the histogram's buckets, s: from an inline step to the default deadline.
const BUCKETS: [f64; 14] =
    [5e-4, 1e-3, 2.5e-3, 5e-3, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0, 30.0];

/// Histogram of durations.
#[derive(Clone, Default)]
struct Histogram {
    /// Counts of the buckets, not cumulative; the last is the overflow.
    counts: [u64; BUCKETS.len() + 1],
    /// s
    sum: f64,
}

/// Responses by method, route and status; ZeroMQ counts as a method, with operations as routes.
type RequestCounts = BTreeMap<&'static str, BTreeMap<String, BTreeMap<u16, u64>>>;

impl Metrics {
    /// Counts a response.
    pub fn count_response(&self, method: &str, route: &str, status: u16) {
        let method = METHODS.into_iter().find(|m| *m == method).unwrap_or("other");
        let mut requests = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        let routes = requests.entry(method).or_default();
        match routes.get_mut(route) {
            Some(counts) => *counts.entry(status).or_default() += 1,
            None => drop(routes.insert(route.into(), BTreeMap::from([(status, 1)]))),
        }
    }

    /// Records the duration of an operation.
    pub fn observe_duration(
        &self,
        transport: &'static str,
        operation: &'static str,
        status: u16,
        seconds: f64,
    ) {
        let outcome = match status {
            0..400 => "ok",
            400..500 => "refused",
            _ => "failed",
        };
        let mut durations = self.durations.lock().unwrap_or_else(PoisonError::into_inner);
        let histogram = durations.entry((transport, operation, outcome)).or_default();
        let bucket = BUCKETS.iter().position(|most| seconds <= *most).unwrap_or(BUCKETS.len());
        histogram.counts[bucket] += 1;
        histogram.sum += seconds;
    }

    /// Counts valid attempts in a world of this kind, and their time steps.
    pub fn count_attempts(&self, kind: WorldKind, valid: u64, steps: u64) {
        self.steps.fetch_add(steps, Ordering::Relaxed);
        self.rollouts.fetch_add(valid, Ordering::Relaxed);
        self.interactions[usize::from(kind == WorldKind::Real)].fetch_add(valid, Ordering::Relaxed);
    }

    /// Counts rollouts simulated by a job outside of clients' worlds.
    pub fn count_rollouts(&self, rollouts: u64) {
        self.rollouts.fetch_add(rollouts, Ordering::Relaxed);
    }

    fn write_requests(&self, out: &mut String) {
        let requests = self.requests.lock().unwrap_or_else(PoisonError::into_inner).clone();
        write_header(out, "iplw_requests_total", "counter", "Requests answered.");
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
            write_sample(
                out,
                "iplw_requests_total",
                &[("method", method), ("route", route), ("status", &status.to_string())],
                *n,
            );
        }
        write_header(out, "iplw_errors_total", "counter", "Requests answered with a problem, by its class.");
        for (class, range) in [("4xx", 400..500), ("5xx", 500..600)] {
            let n = requests.iter().filter(|(_, _, status, _)| range.contains(status)).map(|(.., n)| n).sum();
            write_sample(out, "iplw_errors_total", &[("class", class)], n);
        }
    }

    fn write_durations(&self, out: &mut String) {
        let name = "iplw_request_seconds";
        write_header(
            out,
            name,
            "histogram",
            "Time from a request's head to its answer, by operation and outcome.",
        );
        let durations = self.durations.lock().unwrap_or_else(PoisonError::into_inner).clone();
        for ((transport, operation, outcome), histogram) in &durations {
            let labels = [("transport", *transport), ("operation", *operation), ("outcome", *outcome)];
            let mut within = 0;
            let bounds = BUCKETS.iter().map(f64::to_string).chain(["+Inf".into()]);
            for (bound, count) in bounds.zip(histogram.counts) {
                within += count;
                let of = [&labels[..], &[("le", bound.as_str())]].concat();
                write_sample(out, "iplw_request_seconds_bucket", &of, within);
            }
            let of: Vec<String> = labels.iter().map(|(k, v)| format!("{k}=\"{v}\"")).collect();
            let _ = writeln!(out, "iplw_request_seconds_sum{{{}}} {}", of.join(","), histogram.sum);
            write_sample(out, "iplw_request_seconds_count", &labels, within);
        }
    }

    /// All metrics in Prometheus' text format.
    pub fn text(&self, gauges: &Gauges) -> String {
        let mut out = String::new();
        self.write_requests(&mut out);
        self.write_durations(&mut out);
        write_header(&mut out, "iplw_requests_under_way", "gauge", "Requests in progress or waiting.");
        write_sample(&mut out, "iplw_requests_under_way", &[], gauges.in_progress);
        write_header(&mut out, "iplw_requests_waiting", "gauge", "Requests that wait for a permit.");
        write_sample(&mut out, "iplw_requests_waiting", &[], gauges.waiting);
        write_header(&mut out, "iplw_connections", "gauge", "Open connections.");
        for (transport, n) in ["http", "zmq"].into_iter().zip(gauges.connections) {
            write_sample(&mut out, "iplw_connections", &[("transport", transport)], n);
        }
        write_header(&mut out, "iplw_worlds", "gauge", "Worlds by kind.");
        for (kind, n) in [WorldKind::Sim, WorldKind::Real].into_iter().zip(gauges.worlds) {
            write_sample(&mut out, "iplw_worlds", &[("kind", kind.name())], n);
        }
        write_header(&mut out, "iplw_interactions_total", "counter", "Valid attempts in worlds.");
        for (kind, n) in [WorldKind::Sim, WorldKind::Real].into_iter().zip(&self.interactions) {
            write_sample(
                &mut out,
                "iplw_interactions_total",
                &[("kind", kind.name())],
                n.load(Ordering::Relaxed),
            );
        }
        write_header(
            &mut out,
            "iplw_rollouts_total",
            "counter",
            "Rollouts simulated, including those of ended jobs.",
        );
        write_sample(&mut out, "iplw_rollouts_total", &[], self.rollouts.load(Ordering::Relaxed));
        write_header(
            &mut out,
            "iplw_steps_total",
            "counter",
            "Time steps simulated in worlds, by requests and by jobs.",
        );
        write_sample(&mut out, "iplw_steps_total", &[], self.steps.load(Ordering::Relaxed));
        write_header(&mut out, "iplw_jobs", "gauge", "Jobs by state.");
        for state in JobState::ALL {
            write_sample(
                &mut out,
                "iplw_jobs",
                &[("state", state.name())],
                gauges.jobs.get(state.name()).copied().unwrap_or(0),
            );
        }
        out
    }
}

/// Current values.
pub struct Gauges {
    /// Requests in progress or waiting.
    pub in_progress: u64,
    /// Requests that wait for a permit.
    pub waiting: u64,
    /// Open connections over HTTP and over ZeroMQ.
    pub connections: [u64; 2],
    /// Simulated and real worlds.
    pub worlds: [u64; 2],
    /// Jobs by state.
    pub jobs: BTreeMap<String, u64>,
}

const METHODS: [&str; 8] = ["GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "ZMQ"];

fn write_header(out: &mut String, name: &str, kind: &str, help: &str) {
    let _ = writeln!(out, "# HELP {name} {help}\n# TYPE {name} {kind}");
}

fn write_sample(out: &mut String, name: &str, labels: &[(&str, &str)], value: u64) {
    let labels: Vec<String> = labels.iter().map(|(k, v)| format!("{k}=\"{v}\"")).collect();
    let labels = if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) };
    let _ = writeln!(out, "{name}{labels} {value}");
}
