//! Policies: training, acting, evaluating.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use super::episode::SplitIn;
use super::json_object::JsonObject;
use super::physics::{EffectIn, LatentsIn};
use crate::store::PolicyRow;

/// A policy to train in simulation: in a fixed one (`latents` and `effects`), with domain randomisation (`training`), or in draws
/// from a posterior (`posterior`).
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainIn {
    /// A family (its training tasks are used) or one task.
    pub task: String,
    /// `fixed` (default): one simulation; `randomised`: random latents for every rollout.
    pub training: Option<TrainingIn>,
    /// An `iplw.posterior/2` document: every action is labelled in one of its draws, including their discrepancy fields. Replaces
    /// `training`, `latents` and `effects`.
    #[schema(value_type = Option<Object>)]
    pub posterior: Option<Map<String, Value>>,
    /// Latents of the fixed simulation, such as an estimate. Default: the family's prior mean.
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<JsonObject<LatentsIn>>,
    /// Effects of the simulation.
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<JsonObject<EffectIn>>>,
    /// Training length. `paper` (default): a fixed number of `batches`. `saturating`: early stopping on AUCCESS of the validation
    /// tasks in the same simulation, keeping the best weights and reporting `validation`; uses at least 1000 labels per task and
    /// batches of 64.
    pub preset: Option<TrainPresetIn>,
    /// Number of updates. Default: the family's.
    pub batches: Option<u64>,
    /// Examples per update. Default: the family's.
    pub batch_size: Option<u64>,
    /// Number of evaluations of AUCCESS on validation tasks during training, up to 100; reported in events and result as
    /// `validation`. Default: 0.
    pub validations: Option<u64>,
    pub seed: Option<u64>,
}

/// How the training simulation's latents are chosen.
#[derive(Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TrainingIn {
    Fixed,
    Randomised,
}

/// Training length of a policy.
#[derive(Clone, Copy, PartialEq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TrainPresetIn {
    Paper,
    Saturating,
}

/// A policy.
#[derive(Serialize, ToSchema)]
pub struct PolicyOut {
    pub id: String,
    /// Family whose actions it scores; `any` for built-in policies.
    pub task: String,
    /// `fixed`, `randomised`, `believed`, `direct` (in a real world alone), `learned_on`, `uploaded` or `none`.
    pub training: String,
    /// Description.
    pub about: String,
    /// Configuration of its training.
    #[schema(value_type = Object)]
    pub config: Value,
    /// Id of the job that trained it.
    pub job: Option<String>,
    /// Version of the program that stored it.
    pub version: String,
    /// Size of its weights, bytes.
    pub bytes: u64,
}

/// All policies.
#[derive(Serialize, ToSchema)]
pub struct PoliciesPage {
    pub policies: Vec<PolicyOut>,
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
    pub split: Option<SplitIn>,
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

impl From<PolicyRow> for PolicyOut {
    fn from(p: PolicyRow) -> PolicyOut {
        PolicyOut {
            id: p.id,
            task: p.task,
            training: p.training,
            about: p.about,
            config: p.config,
            job: p.job,
            version: p.version,
            bytes: p.bytes,
        }
    }
}

impl BinaryArrays for ProposedActions {}
impl BinaryArrays for PoliciesPage {}
impl BinaryArrays for PolicyOut {}
