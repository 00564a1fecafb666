//! `iplw.plan/1`: a plan as it is written and sent.

use serde::{Deserialize, Serialize};

use crate::estimate::Belief;
use crate::estimate::belief::Source;

use super::config::PlanConfig;
use super::ranked::{Plan, Ranked};

/// The format's name.
pub const PLAN_FORMAT: &str = "iplw.plan/1";
/// Most actions that are told: as many as attempts count.
pub const MOST_ROWS: usize = crate::policy::auccess::ATTEMPTS;

/// A plan with everything that it follows from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanDocument {
    pub format: String,
    /// Of the program.
    pub version: String,
    /// Id of the task.
    pub task: String,
    pub config: PlanConfig,
    pub belief: BeliefAbout,
    /// Actions looked at, those that cannot be placed among them.
    pub candidates: usize,
    /// Those.
    pub invalid: usize,
    /// Copies that were tried.
    pub rollouts: usize,
    /// Whether the first `config.exact` actions are those of trying everything.
    pub complete: bool,
    /// Best first, at most [`MOST_ROWS`].
    pub actions: Vec<ActionRow>,
}

/// The belief under which it was made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BeliefAbout {
    pub source: Source,
    /// Worlds that it holds.
    pub draws: usize,
}

/// An action of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionRow {
    /// Components in [0, 1].
    pub action: Vec<f64>,
    /// Copies that solved, of those that it was ranked by.
    pub successes: usize,
    /// Those.
    pub draws: usize,
    /// (successes + 1) / (draws + 2): what actions are ordered by. Too good to be a probability: the best were chosen by it.
    pub share: f64,
    /// Share of fresh copies that solved, which had no say in the order; of the best `config.exact` only.
    pub probability: Option<f64>,
    /// Its standard error, the deviation of Beta(1 + successes, 1 + failures).
    pub standard_error: Option<f64>,
}

/// A plan as a document.
pub fn document(plan: &Plan, config: &PlanConfig, belief: &Belief) -> PlanDocument {
    PlanDocument {
        format: PLAN_FORMAT.into(),
        version: env!("CARGO_PKG_VERSION").into(),
        task: plan.task.clone(),
        config: config.clone(),
        belief: BeliefAbout { source: belief.source(), draws: belief.draws().len() },
        candidates: plan.ranked.len() + plan.invalid,
        invalid: plan.invalid,
        rollouts: plan.rollouts,
        complete: plan.complete,
        actions: plan.ranked.iter().take(MOST_ROWS).map(row).collect(),
    }
}

fn row(ranked: &Ranked) -> ActionRow {
    ActionRow {
        action: ranked.action.values().to_vec(),
        successes: ranked.raced.successes,
        draws: ranked.raced.tried,
        share: ranked.raced.share(),
        probability: ranked.fresh.map(|f| f.mean()),
        standard_error: ranked.fresh.map(|f| f.standard_error()),
    }
}
