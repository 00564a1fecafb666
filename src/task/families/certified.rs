//! How a family's tasks are picked and what each brings as evidence that it can be solved; `reality::certify` does it.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Seed from which families' candidates are drawn.
pub const CANDIDATE_SEED: u64 = 0;
/// The value of the `format` field of a file of certified tasks.
pub const CERTIFIED_FORMAT: &str = "iplw.certified/1";

/// Which candidates become tasks: so many within each range of the share of valid actions that solve them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Selection {
    /// Ranges of the share, rising.
    pub bins: Vec<Bin>,
    /// Whether the share is taken in the real world or in the same world without its unmodelled effects.
    pub in_real_world: bool,
    /// Valid actions sampled for each share.
    pub sample: usize,
}

/// A range of the share of valid actions that solve a task, and how many tasks it is to have.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bin {
    /// Least share.
    pub from: f64,
    /// Largest share.
    pub to: f64,
    /// Tasks.
    pub tasks: usize,
}

/// A family's file of certified tasks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certified {
    /// Always [`CERTIFIED_FORMAT`].
    pub format: String,
    /// Name of the family.
    pub family: String,
    /// [`Family::digest`](super::Family::digest) of the family that was certified: the tasks are of no other.
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

impl Selection {
    /// Tasks that are wanted.
    pub fn wanted(&self) -> usize {
        self.bins.iter().map(|b| b.tasks).sum()
    }
}

impl Certified {
    /// Parses a file; whether it belongs to a family is that family's to say.
    pub fn from_json(text: &str) -> Result<Certified> {
        let found: Certified = crate::json::parse(text)?;
        if found.format != CERTIFIED_FORMAT {
            return Err(Error::input(
                "format",
                format!("{:?}", found.format),
                format!("{CERTIFIED_FORMAT:?}"),
            ));
        }
        Ok(found)
    }

    /// The file: a task a line.
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
