//! Policies: training, acting, evaluating.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use crate::store::PolicyRow;
use crate::task::Split;

/// All policies.
#[derive(Serialize, ToSchema)]
pub struct PoliciesPage {
    pub policies: Vec<PolicyRow>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// Request for actions.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ActIn {
    /// Id of the task.
    pub task: String,
    /// Number of actions, up to 10,000. Default: 1.
    pub count: Option<u64>,
}

/// The highest-ranked actions that can be placed, best first.
#[derive(Serialize, ToSchema)]
pub struct ProposedActions {
    pub actions: Vec<ScoredAction>,
}

/// A discrete action and its score.
#[derive(Serialize, ToSchema)]
pub struct ScoredAction {
    pub index: usize,
    pub action: Vec<f64>,
    /// Higher scores are more likely to solve the task.
    pub score: f32,
}

/// An evaluation to run.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EvaluateIn {
    /// Id of a world of the policy's family; attempts are counted there.
    pub world: String,
    /// Split to evaluate. Default: `test`.
    pub split: Option<Split>,
    /// Maximum number of valid attempts per task, 1 to 100. Default: 100.
    pub attempts: Option<u64>,
    /// Seed that selects the 10,000 discrete actions to rank.
    pub seed: Option<u64>,
    /// For the policy `ranked`: the client's ranking of actions, instead of a split.
    pub ranking: Option<Vec<RankingIn>>,
}

/// A ranking of a task's actions.
#[derive(Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RankingIn {
    /// Id of a task of the world.
    pub task: String,
    /// Action vectors, best first; give more than 100 if some cannot be placed.
    pub actions: Vec<Vec<f64>>,
}

/// Fine-tuning of a policy in a world.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnIn {
    /// Id of a world of the policy's family; attempts are counted there.
    pub world: String,
    /// Number of random valid attempts to learn from. Default: batches times batch size.
    pub attempts: Option<u64>,
    /// Number of updates. Default: 125.
    pub batches: Option<u64>,
    /// Examples per update, half of them solving. Default: 32.
    pub batch_size: Option<u64>,
    /// Adam's initial learning rate. Default: 0.0005.
    pub learning_rate: Option<f64>,
    pub seed: Option<u64>,
}

impl BinaryArrays for ProposedActions {}
impl BinaryArrays for PoliciesPage {}
impl BinaryArrays for PolicyRow {}
