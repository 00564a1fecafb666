//! `iplw.design/1`: the design document.

use serde::{Deserialize, Serialize};

use super::config::DesignConfig;
use super::costs;
use super::gain::InformationGain;
use super::posterior_sd::ExpectedSd;
use super::question::Question;
use super::search::{Design, Experiment};
use crate::number::significant;

/// The format's name.
pub const DESIGN_FORMAT: &str = "iplw.design/1";
/// Minimal relative reduction of a parameter's standard deviation for the parameter to be mentioned.
const MIN_SD_REDUCTION: f64 = 0.2;

/// A design with the configuration that reproduces it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DesignDocument {
    pub format: String,
    /// Version of the program.
    pub version: String,
    pub config: DesignConfig,
    /// Sets of effects in the posterior, and the probability of each.
    pub sets: Vec<SetRow>,
    /// Number of candidates that were evaluated.
    pub candidates: usize,
    pub rollouts: usize,
    /// Information gain of the whole batch.
    pub together: InformationGain,
    /// Cost of the batch, in the unit of `config.costs`.
    #[serde(default)]
    pub cost: f64,
    /// The batch, in order.
    pub experiments: Vec<ExperimentRow>,
    /// Other shortlisted experiments, the most informative first.
    pub others: Vec<ExperimentRow>,
}

/// A set of effects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetRow {
    pub effects: Vec<String>,
    pub weight: f64,
}

/// An experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExperimentRow {
    pub task: String,
    /// Components in [0, 1].
    pub action: Vec<f64>,
    /// Information gain of this experiment alone.
    #[serde(flatten)]
    pub gain: InformationGain,
    /// Information gain beyond the experiments of the batch before it, nats.
    pub adds: Option<f64>,
    /// Cost: after the experiments of the batch before it, or alone.
    #[serde(default)]
    pub cost: f64,
    /// Expected standard deviations of the parameters that all draws share.
    pub expected: Vec<ExpectedSd>,
    /// Contacts begun between movable bodies, and seconds on surfaces summed over bodies; means over worlds.
    pub collisions: f64,
    pub rolling_s: f64,
    /// Reason for the choice, in words.
    pub reason: String,
}

/// A design as a document.
pub fn document(design: &Design, config: &DesignConfig) -> DesignDocument {
    let row = |e: &Experiment| ExperimentRow {
        task: e.task.clone(),
        action: e.action.values().to_vec(),
        gain: e.gain,
        adds: e.adds,
        cost: e.cost,
        expected: e.expected.clone(),
        collisions: e.collisions,
        rolling_s: e.rolling,
        reason: reason(e, design, config),
    };
    let rows: Vec<ExperimentRow> = design.experiments.iter().map(row).collect();
    let (batch, others) = rows.split_at(design.batch);
    DesignDocument {
        format: DESIGN_FORMAT.into(),
        version: env!("CARGO_PKG_VERSION").into(),
        config: config.clone(),
        sets: design
            .sets
            .iter()
            .map(|(effects, weight)| SetRow { effects: effects.clone(), weight: *weight })
            .collect(),
        candidates: design.candidates,
        rollouts: design.rollouts,
        together: design.together,
        cost: batch.iter().map(|row| row.cost).sum(),
        experiments: batch.to_vec(),
        others: others.to_vec(),
    }
}

/// The information that an experiment is expected to bring, in words.
fn reason(e: &Experiment, design: &Design, config: &DesignConfig) -> String {
    let information = match (&config.question, e.gain.right) {
        _ if e.gain.information == 0.0 => "adds no information to the posterior".to_string(),
        (Question::Effects, Some([before, after])) => {
            let sets: Vec<String> = design.sets.iter().map(|(s, _)| set_name(s)).collect();
            format!(
                "discriminates between {}: expected probability of the right one {after:.2}, {before:.2} before",
                sets.join(", ")
            )
        }
        (Question::Success, Some([before, after])) => {
            format!("predicts whether plans work: right with probability {after:.2}, {before:.2} before")
        }
        _ => {
            let mut most: Vec<&ExpectedSd> =
                e.expected.iter().filter(|n| n.after < (1.0 - MIN_SD_REDUCTION) * n.before).collect();
            most.sort_by(|a, b| (a.after / a.before).total_cmp(&(b.after / b.before)));
            let each = most.iter().map(|n| {
                format!("{} from {} to {}", n.name, significant(n.before, 2), significant(n.after, 2))
            });
            match most.is_empty() {
                true => "narrows no parameter linearly, but discriminates between worlds".to_string(),
                false => format!("narrows {}", each.collect::<Vec<_>>().join(", ")),
            }
        }
    };
    let cost_note = match (config.costs.is_uniform(), e.cost > config.costs.trial) {
        (true, _) => String::new(),
        (false, true) => format!("; costs {} with setting up", costs::rounded(e.cost)),
        (false, false) => format!("; costs {}", costs::rounded(e.cost)),
    };
    format!("{information}; {:.1} collisions, {:.1} s on surfaces{cost_note}", e.collisions, e.rolling)
}

fn set_name(set: &[String]) -> String {
    if set.is_empty() { "no effect".into() } else { set.join(" + ") }
}
