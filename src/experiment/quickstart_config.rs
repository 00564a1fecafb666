//! Configuration of the end-to-end experiment on one family.

use serde::{Deserialize, Serialize};

use super::{EstimateConfig, ResidualKind};
use crate::plan::PlanConfig;
use crate::policy::{EvaluateConfig, LabelConfig, TrainConfig};
use crate::task::{Family, LabelCounts, Learning};

/// Labelled actions of a training task, updates and units per layer of a policy, and candidate actions of an evaluation. Fewer updates
/// leave the levels' policies untrained; units per layer are fewer than usual, so that all rows of three seeds take minutes.
const LABELS_PER_TASK: usize = 600;
const BATCHES: usize = 3000;
const UNITS: usize = 96;
const CANDIDATES: usize = 2000;
/// Posterior draws on which an action of a plan is evaluated.
const PLAN_DRAWS: usize = 16;

/// Configuration of the experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuickstartConfig {
    /// Name of the task family.
    pub family: String,
    /// Prior mean and standard deviation of density, friction and restitution.
    pub prior: [(f64, f64); 3],
    /// Seeds, one repetition of the experiment each.
    pub seeds: Vec<u64>,
    /// The estimation as in the paper; its seed is replaced by each of `seeds`.
    pub paper: EstimateConfig,
    /// The estimation with informative actions, whose trials are diagnosed.
    pub informative: EstimateConfig,
    /// Labelling of training actions.
    pub label: LabelConfig,
    /// Training of policies.
    pub train: TrainConfig,
    /// Evaluation of policies.
    pub evaluate: EvaluateConfig,
    /// Plans under the posterior.
    pub plan: PlanConfig,
}

impl QuickstartConfig {
    /// The usual configuration; `quick` for a smoke test with few labels and candidates.
    pub fn standard(family: &Family, seeds: Vec<u64>, quick: bool) -> QuickstartConfig {
        let usual = EstimateConfig::fast(family.prior);
        let labels =
            LabelCounts { per_task: if quick { 40 } else { LABELS_PER_TASK }, ..family.learning.labels };
        let learning = Learning { batches: if quick { BATCHES / 5 } else { BATCHES }, ..family.learning };
        let candidates = if quick { 500 } else { CANDIDATES };
        QuickstartConfig {
            family: family.name.into(),
            prior: family.prior,
            seeds,
            informative: EstimateConfig {
                strategy: "informative".into(),
                residual: ResidualKind::Shooting,
                actions: 5,
                ..usual.clone()
            },
            paper: usual,
            label: LabelConfig::preset(&labels, 0),
            train: TrainConfig { hidden: UNITS, ..TrainConfig::preset(&learning) },
            evaluate: EvaluateConfig { candidates, ..EvaluateConfig::phyre(0) },
            plan: PlanConfig { actions: candidates, draws: PLAN_DRAWS, ..PlanConfig::standard(0) },
        }
    }
}
