//! What a plan is to be.

use serde::{Deserialize, Serialize};

use crate::error::{Result, within};
use crate::policy::EvaluateConfig;
use crate::world::Engine;

/// How a plan is searched for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanConfig {
    /// Discrete actions that are ranked: all of the task's if there are no more, else a random subset.
    pub actions: usize,
    /// Worlds of the belief in which an action that is tried to the end is tried, and again as many fresh ones for the best.
    pub draws: usize,
    /// Most that a component of an action is moved in a copy; 0 tries actions as they are.
    pub perturb: f64,
    /// So many of the best are those of trying everything, and are tried again under fresh draws.
    pub exact: usize,
    /// Draws of the first look at every action. With less the race begins blind, and the rest have a coarser order; with more
    /// it takes longer.
    pub look: usize,
    /// Most rollouts of the race; without an end the best are exact, with one the answer may not be complete.
    pub rollouts: Option<usize>,
    pub engine: Engine,
    /// Decides the subset of actions, the draws and how copies are moved.
    pub seed: u64,
}

impl PlanConfig {
    /// 10,000 actions as PHYRE ranks, under 64 draws (a standard error of at most 0.0625), moved as in certificates.
    pub fn standard(seed: u64) -> PlanConfig {
        PlanConfig {
            actions: 10_000,
            draws: 64,
            perturb: crate::reality::certify::PERTURBATION,
            exact: 10,
            look: 2,
            rollouts: None,
            engine: Engine::Auto,
            seed,
        }
    }

    /// Errors unless everything is within what a plan can be.
    pub fn validate(&self) -> Result<()> {
        within("actions", self.actions as f64, 1.0, 1e6)?;
        within("draws", self.draws as f64, 1.0, 10_000.0)?;
        within("perturb", self.perturb, 0.0, 1.0)?;
        within("exact", self.exact as f64, 1.0, 1000.0)?;
        within("look", self.look as f64, 1.0, 10_000.0)?;
        self.rollouts.map_or(Ok(0.0), |most| within("rollouts", most as f64, 1.0, 1e12))?;
        Ok(())
    }

    /// Which actions are candidates: those that an evaluation with the same number and seed ranks.
    pub fn candidates(&self) -> EvaluateConfig {
        EvaluateConfig { candidates: self.actions, ..EvaluateConfig::phyre(self.seed) }
    }
}
