//! `iplw.design/1`: a design as it is written and sent.

use serde::{Deserialize, Serialize};

use super::config::DesignConfig;
use super::costs;
use super::gain::Gain;
use super::narrowed::Narrowed;
use super::question::Question;
use super::search::{Design, Experiment};

/// The format's name.
pub const DESIGN_FORMAT: &str = "iplw.design/1";
/// Least share of its spread that a number must lose to be spoken of.
const SPOKEN: f64 = 0.2;

/// A design with everything that it follows from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DesignDocument {
    pub format: String,
    /// Of the program.
    pub version: String,
    pub config: DesignConfig,
    /// Sets of effects of the belief, and how likely each is.
    pub sets: Vec<SetRow>,
    /// Candidates that were looked at.
    pub candidates: usize,
    pub rollouts: usize,
    /// What the batch tells together.
    pub together: Gain,
    /// What the batch costs, in the unit of `config.costs`.
    #[serde(default)]
    pub cost: f64,
    /// The batch, in order.
    pub experiments: Vec<ExperimentRow>,
    /// Others that were looked at closely, the most telling first.
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
    /// What it tells by itself.
    #[serde(flatten)]
    pub gain: Gain,
    /// What it adds to those of the batch before it, nats.
    pub adds: Option<f64>,
    /// What it costs: after those of the batch before it, or by itself.
    #[serde(default)]
    pub cost: f64,
    /// How far numbers that all draws have would be known, standard deviations.
    pub expected: Vec<Narrowed>,
    /// Contacts begun between movable bodies, and seconds on surfaces summed over bodies; means over worlds.
    pub collisions: f64,
    pub rolling_s: f64,
    /// Why it was chosen, for people.
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

/// What an experiment is expected to tell, in words.
fn reason(e: &Experiment, design: &Design, config: &DesignConfig) -> String {
    let told = match (&config.question, e.gain.right) {
        _ if e.gain.information == 0.0 => "tells nothing that is not believed already".to_string(),
        (Question::Effects, Some([before, after])) => {
            let sets: Vec<String> = design.sets.iter().map(|(s, _)| named(s)).collect();
            format!(
                "tells {} apart: the right one is believed at {after:.2}, at {before:.2} before",
                sets.join(", ")
            )
        }
        (Question::Success, Some([before, after])) => {
            format!("tells whether plans work: right at {after:.2}, at {before:.2} before")
        }
        _ => {
            let mut most: Vec<&Narrowed> =
                e.expected.iter().filter(|n| n.after < (1.0 - SPOKEN) * n.before).collect();
            most.sort_by(|a, b| (a.after / a.before).total_cmp(&(b.after / b.before)));
            let each = most.iter().map(|n| format!("{} from {:.2e} to {:.2e}", n.name, n.before, n.after));
            match most.is_empty() {
                true => {
                    "narrows no number by a straight guess, but tells some worlds from others".to_string()
                }
                false => format!("narrows {}", each.collect::<Vec<_>>().join(", ")),
            }
        }
    };
    let paid = match (config.costs.alike(), e.cost > config.costs.trial) {
        (true, _) => String::new(),
        (false, true) => format!("; costs {} with setting up", costs::shown(e.cost)),
        (false, false) => format!("; costs {}", costs::shown(e.cost)),
    };
    format!("{told}; {:.1} collisions, {:.1} s on surfaces{paid}", e.collisions, e.rolling)
}

fn named(set: &[String]) -> String {
    if set.is_empty() { "no effect".into() } else { set.join(" + ") }
}
