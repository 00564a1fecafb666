//! How a family's tasks are picked and what each brings as evidence that it can be solved; `reality::certify` does it.

use serde::{Deserialize, Serialize};

/// Seed from which the built-in families' candidates are drawn.
pub const CANDIDATE_SEED: u64 = 0;

/// Which candidates become tasks: so many within each range of the share of valid actions that solve them.
pub struct Selection {
    /// (least share, largest share, number of tasks)
    pub bins: &'static [(f64, f64, usize)],
    /// Whether the share is taken in the real world or in the same world without its unmodelled effects.
    pub in_real_world: bool,
    /// Valid actions sampled for each share.
    pub sample: usize,
}

/// One row of a family's file of certified tasks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CertifiedRow {
    /// Index into the family's candidates for [`CANDIDATE_SEED`].
    pub candidate: usize,
    /// The evidence.
    pub certificate: Certificate,
}

/// A solution that survives small perturbations, and how easy the task is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// An action that solves the task in the family's real world, as do its perturbed neighbours.
    pub action: Vec<f64>,
    /// Seed of the search and of the perturbations.
    pub seed: u64,
    /// Share of valid discrete actions that solve the task in the family's real world, from a random sample.
    pub solving_share: f64,
    /// The same in the same world without its unmodelled effects.
    pub solving_share_undamped: f64,
}
