//! `iplw.plan/1`: the plan document.

use serde::{Deserialize, Serialize};

use crate::estimate::ParameterSamples;
use crate::estimate::parameter_samples::SampleSource;
use crate::task::Task;

use super::action_map::{ActionMap, action_maps};
use super::config::PlanConfig;
use super::ranked::{Plan, RankedAction};

/// The format's name.
pub const PLAN_FORMAT: &str = "iplw.plan/1";
/// Maximal number of actions in a document: the number of attempts that count.
pub const MAX_ROWS: usize = crate::policy::auccess::MAX_ATTEMPTS;

/// A plan with the configuration that reproduces it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanDocument {
    pub format: String,
    /// Version of the program.
    pub version: String,
    /// Id of the task.
    pub task: String,
    pub config: PlanConfig,
    pub posterior: SamplesSummary,
    /// Number of candidate actions, including invalid ones.
    pub candidates: usize,
    /// Number of candidate actions that can't be placed.
    pub invalid: usize,
    /// Number of rollouts.
    pub rollouts: usize,
    /// Whether the first `config.exact` actions are those of an exhaustive evaluation.
    pub complete: bool,
    /// Best first, at most [`MAX_ROWS`].
    pub actions: Vec<ActionRow>,
    /// Success rates over the action space, of all ranked actions.
    #[serde(default)]
    pub maps: Vec<ActionMap>,
}

/// The parameter samples that a plan is based on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SamplesSummary {
    pub source: SampleSource,
    /// Number of samples.
    pub draws: usize,
}

/// An action of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionRow {
    /// Components in [0, 1].
    pub action: Vec<f64>,
    /// Rollouts that solved the task, of those used for ranking.
    pub successes: usize,
    /// Rollouts used for ranking.
    pub draws: usize,
    /// (successes + 1) / (draws + 2): the sort key of actions. Biased upwards as a probability, since the best were selected by it.
    pub share: f64,
    /// Success rate in fresh rollouts, not used for ranking; for the best `config.exact` only.
    pub probability: Option<f64>,
    /// Its standard error: the standard deviation of Beta(1 + successes, 1 + failures).
    pub standard_error: Option<f64>,
}

impl ActionRow {
    /// The unbiased probability of success if there are fresh rollouts, else the share by which it was ranked.
    pub fn best_probability(&self) -> f64 {
        self.probability.unwrap_or(self.share)
    }
}

/// A plan as a document.
pub fn document(task: &Task, plan: &Plan, config: &PlanConfig, samples: &ParameterSamples) -> PlanDocument {
    PlanDocument {
        format: PLAN_FORMAT.into(),
        version: env!("CARGO_PKG_VERSION").into(),
        task: plan.task.clone(),
        config: config.clone(),
        posterior: SamplesSummary { source: samples.source(), draws: samples.draws().len() },
        candidates: plan.ranked.len() + plan.invalid,
        invalid: plan.invalid,
        rollouts: plan.rollouts,
        complete: plan.complete,
        actions: plan.ranked.iter().take(MAX_ROWS).map(row).collect(),
        maps: action_maps(task, plan),
    }
}

fn row(ranked: &RankedAction) -> ActionRow {
    ActionRow {
        action: ranked.action.values().to_vec(),
        successes: ranked.ranking_count.successes,
        draws: ranked.ranking_count.rollouts,
        share: ranked.ranking_count.smoothed_share(),
        probability: ranked.fresh_count.map(|f| f.mean()),
        standard_error: ranked.fresh_count.map(|f| f.standard_error()),
    }
}
