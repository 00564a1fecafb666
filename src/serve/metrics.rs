//! Counters, gauges and histograms in Prometheus' text format.

use prometheus_client::encoding::prometheus_text;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Metric, Registry};

use crate::session::WorldKind;

/// Counters and histograms of the running server.
pub struct Metrics {
    registry: Registry,
    /// Responses by method, route and status; ZeroMQ counts as a method, with operations as routes.
    requests: Family<[(&'static str, String); 3], Counter>,
    /// Problems by class of their status.
    errors: Family<[Label; 1], Counter>,
    /// Seconds by transport, operation and outcome.
    durations: Family<[Label; 3], Histogram, fn() -> Histogram>,
    /// Valid attempts by kind of the world.
    interactions: Family<[Label; 1], Counter>,
    rollouts: Counter,
    steps: Counter,
}

/// Name and value of a label.
pub type Label = (&'static str, &'static str);

/// Name, description, and current values by labels.
pub type GaugeSamples = (&'static str, &'static str, Vec<(Vec<Label>, usize)>);

/// Upper bounds of the histogram's buckets, s: from an inline step to the default deadline.
const BUCKETS: [f64; 14] =
    [5e-4, 1e-3, 2.5e-3, 5e-3, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0, 30.0];

const METHODS: [&str; 8] = ["GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "ZMQ"];

impl Default for Metrics {
    fn default() -> Metrics {
        fn add<M: Metric + Clone>(registry: &mut Registry, name: &str, help: &str, metric: M) -> M {
            registry.register(name, help, metric.clone());
            metric
        }
        let mut registry = Registry::default();
        let to = &mut registry;
        // The registry appends `_total` to the names of counters, and a full stop to descriptions.
        let requests = add(to, "iplw_requests", "Requests answered", Family::default());
        let errors = Family::default();
        let errors = add(to, "iplw_errors", "Requests answered with a problem, by its class", errors);
        let help = "Time from a request's head to its answer, by operation and outcome";
        let durations: Family<_, _, fn() -> Histogram> =
            Family::new_with_constructor(|| Histogram::new(BUCKETS));
        let durations = add(to, "iplw_request_seconds", help, durations);
        let interactions = add(to, "iplw_interactions", "Valid attempts in worlds", Family::default());
        let help = "Rollouts simulated, including those of ended jobs";
        let rollouts = add(to, "iplw_rollouts", help, Counter::default());
        let help = "Time steps simulated in worlds, by requests and by jobs";
        let steps = add(to, "iplw_steps", help, Counter::default());
        let metrics = Metrics { registry, requests, errors, durations, interactions, rollouts, steps };
        for class in ["4xx", "5xx"] {
            metrics.errors.get_or_create(&[("class", class)]).inc_by(0);
        }
        for kind in [WorldKind::Sim, WorldKind::Real] {
            metrics.count_attempts(kind, 0, 0);
        }
        metrics
    }
}

impl Metrics {
    /// Counts a response.
    pub fn count_response(&self, method: &str, route: &str, status: u16) {
        let method = METHODS.into_iter().find(|m| *m == method).unwrap_or("other");
        let labels = [("method", method.into()), ("route", route.into()), ("status", status.to_string())];
        self.requests.get_or_create(&labels).inc();
        if let 400..600 = status {
            self.errors.get_or_create(&[("class", if status < 500 { "4xx" } else { "5xx" })]).inc();
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
        let labels = [("transport", transport), ("operation", operation), ("outcome", outcome)];
        self.durations.get_or_create(&labels).observe(seconds);
    }

    /// Counts valid attempts in a world of this kind, and their time steps.
    pub fn count_attempts(&self, kind: WorldKind, valid: u64, steps: u64) {
        self.steps.inc_by(steps);
        self.rollouts.inc_by(valid);
        self.interactions.get_or_create(&[("kind", kind.name())]).inc_by(valid);
    }

    /// Counts rollouts simulated by a job outside of clients' worlds.
    pub fn count_rollouts(&self, rollouts: u64) {
        self.rollouts.inc_by(rollouts);
    }

    /// All metrics in Prometheus' text format.
    pub fn text(&self, gauges: Vec<GaugeSamples>) -> String {
        let mut current = Registry::default();
        for (name, help, samples) in gauges {
            let gauge: Family<Vec<Label>, Gauge> = Family::default();
            for (labels, value) in samples {
                gauge.get_or_create(&labels).set(value as i64);
            }
            current.register(name, help, gauge);
        }
        let mut out = String::new();
        for registry in [&self.registry, &current] {
            prometheus_text::encode(&mut out, registry).expect("a string accepts every text");
        }
        out
    }
}
