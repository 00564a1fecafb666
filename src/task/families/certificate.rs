//! Certified tasks of a family: the selection criteria and each task's verified solution; `reality::certify`
//! computes them.

use serde::{Deserialize, Serialize};

use crate::error::{Result, check_format};

/// Seed of the families' candidates.
pub const CANDIDATE_SEED: u64 = 0;
/// The value of the `format` field of a file of certified tasks.
pub const CERTIFIED_FORMAT: &str = "iplw.certified/1";

/// Selection of candidates by task difficulty: a number of tasks for each range of the solving share.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Selection {
    /// Ranges of the solving share, in increasing order.
    pub bins: Vec<SolvingShareBin>,
    /// Whether the share is measured in the real world or in the same world without its unmodelled
    /// effects.
    pub in_real_world: bool,
    /// Number of valid actions sampled to estimate each share.
    pub sample: usize,
}

/// A range of the solving share (the fraction of valid actions that solve a task) and the number of tasks to
/// select from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolvingShareBin {
    /// Lower bound of the share.
    pub from: f64,
    /// Upper bound of the share.
    pub to: f64,
    /// Number of tasks.
    pub tasks: usize,
}

/// A family's file of certified tasks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CertifiedTasks {
    /// Always [`CERTIFIED_FORMAT`].
    pub format: String,
    /// Name of the family.
    pub family: String,
    /// [`Family::digest`](super::Family::digest) of the certified family; the tasks are valid for no
    /// other.
    pub digest: String,
    /// The tasks, in order of candidate.
    pub rows: Vec<CertifiedRow>,
}

/// One row of a family's file of certified tasks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CertifiedRow {
    /// Index into the family's candidates for [`CANDIDATE_SEED`].
    pub candidate: usize,
    /// The verified solution.
    pub certificate: Certificate,
}

/// A solution that is robust to small perturbations, and the difficulty of the task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// An action that solves the task in the family's real world, as its perturbed neighbours do.
    pub action: Vec<f64>,
    /// Seed of the search and of the perturbations.
    pub seed: u64,
    /// Fraction of valid discrete actions that solve the task in the family's real world, from a random
    /// sample.
    pub solving_share: f64,
    /// The same in the real world without its unmodelled effects.
    pub solving_share_undamped: f64,
}

impl Selection {
    /// Total number of tasks to select.
    pub fn n_tasks(&self) -> usize {
        self.bins.iter().map(|b| b.tasks).sum()
    }
}

impl CertifiedTasks {
    /// Parses a file; [`Family::with_tasks`](super::Family) checks that it belongs to the family.
    pub fn from_json(text: &str) -> Result<CertifiedTasks> {
        let found: CertifiedTasks = crate::json::parse(text)?;
        check_format(&found.format, CERTIFIED_FORMAT)?;
        Ok(found)
    }

    /// The file's text, one task a line.
    pub fn to_json(&self) -> String {
        let rows: Vec<String> = self.rows.iter().map(text).collect();
        let (format, family, digest) = (text(&self.format), text(&self.family), text(&self.digest));
        let rows = rows.join(",\n");
        format!(
            "{{\"format\": {format}, \"family\": {family}, \"digest\": {digest}, \"rows\": [\n{rows}\n]}}\n"
        )
    }
}

fn text(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("texts and rows of numbers are representable as JSON")
}
