//! Configuration of a planner.

use serde::{Deserialize, Serialize};

use crate::error::{Result, check_range};
use crate::policy::EvaluateConfig;
use crate::world::Engine;

/// How the best actions are searched for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanConfig {
    /// Number of discrete actions to rank: a random subset where the task has more.
    pub actions: usize,
    /// Posterior draws for a fully evaluated action; the best are evaluated again with the same number of fresh draws.
    pub draws: usize,
    /// Maximal perturbation of an action component in a rollout; 0 for none.
    pub perturb: f64,
    /// Number of best actions that are exactly those of an exhaustive evaluation, and are evaluated again with fresh draws.
    pub exact: usize,
    /// Initial draws of every action. Fewer make the first elimination and the order of the other actions coarser; more take longer.
    pub look: usize,
    /// Maximal number of rollouts, without fresh draws; with a limit the result may be incomplete.
    pub rollouts: Option<usize>,
    pub engine: Engine,
    /// Seed of the subset of actions, the draws and the perturbations.
    pub seed: u64,
}

impl PlanConfig {
    /// 10,000 actions (as PHYRE) and 64 draws (a standard error of at most 0.0625), perturbed as in certificates.
    pub fn standard(seed: u64) -> PlanConfig {
        PlanConfig {
            actions: 10_000,
            draws: 64,
            perturb: crate::reality::certify::MAX_PERTURBATION,
            exact: 10,
            look: 2,
            rollouts: None,
            engine: Engine::Auto,
            seed,
        }
    }

    /// Errors unless every value is within its range.
    pub fn validate(&self) -> Result<()> {
        check_range("actions", self.actions as f64, 1.0, 1e6)?;
        check_range("draws", self.draws as f64, 1.0, 10_000.0)?;
        check_range("perturb", self.perturb, 0.0, 1.0)?;
        check_range("exact", self.exact as f64, 1.0, 1000.0)?;
        check_range("look", self.look as f64, 1.0, 10_000.0)?;
        self.rollouts.map_or(Ok(0.0), |most| check_range("rollouts", most as f64, 1.0, 1e12))?;
        Ok(())
    }

    /// The candidate actions: those that an evaluation with the same number and seed ranks.
    pub fn candidates(&self) -> EvaluateConfig {
        EvaluateConfig { candidates: self.actions, ..EvaluateConfig::phyre(self.seed) }
    }
}
