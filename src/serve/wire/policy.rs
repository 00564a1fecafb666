//! Policies: training, acting, evaluating.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::bulk::Bulk;
use super::episode::SplitIn;
use super::physics::{EffectIn, LatentsIn};
use super::strict::Object;
use crate::store::PolicyRow;

/// A policy to train in simulation: one (`latents`, and `effects`), one drawn for every rollout (`training`), or what is known
/// (`belief`).
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainIn {
    /// A family (its training tasks are used) or one task.
    pub task: String,
    /// `fixed` (the default): one simulation; `randomised`: every rollout draws its latents.
    pub training: Option<TrainingIn>,
    /// An `iplw.posterior/1` document: every action is labelled in one of its equally likely draws, what they
    /// carry without a name included. Stands in the place of
    /// `training`, `latents` and `effects`.
    #[schema(value_type = Option<Object>)]
    pub belief: Option<Map<String, Value>>,
    /// Of the fixed simulation; those absent are the family's prior mean. An estimate goes here.
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<Object<LatentsIn>>,
    /// Effects of the simulation.
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<Object<EffectIn>>>,
    /// How long: `paper` (the default), so many `batches`; `saturating`, stretches of the family's own number of batches until
    /// AUCCESS on its validation tasks, tried in the same simulation, grows no more. The best weights are kept; what
    /// was found after each stretch is told as `validation`. It takes 1000 labels a task and batches of 64, or the family's
    /// own if they are more.
    pub preset: Option<TrainPresetIn>,
    /// Updates; the family's own number if absent.
    pub batches: Option<u64>,
    /// Examples per update; the family's own number if absent.
    pub batch_size: Option<u64>,
    /// How often AUCCESS on labelled actions of validation tasks is looked at along the way, in the same simulation, up to 100;
    /// default 0. Told in the job's events (`validation`) and result.
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

/// How long a policy is trained.
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
    /// Family it scores actions of; `any` for those that are always there.
    pub task: String,
    /// `fixed`, `randomised`, `believed`, `direct` (in a real world alone), `learned_on`, `uploaded` or `none`.
    pub training: String,
    /// What it is and how it came about.
    pub about: String,
    /// What it was trained with.
    #[schema(value_type = Object)]
    pub config: Value,
    /// Id of the job that trained it.
    pub job: Option<String>,
    /// Version of the program that stored it.
    pub version: String,
    /// Size of its weights.
    pub bytes: u64,
}

/// All policies.
#[derive(Serialize, ToSchema)]
pub struct Policies {
    pub policies: Vec<PolicyOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// Which actions to propose.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ActIn {
    /// Id of the task.
    pub task: String,
    /// How many, up to 10,000; default 1.
    pub count: Option<u64>,
}

/// Proposed actions, best first; all of them can be placed.
#[derive(Serialize, ToSchema)]
pub struct Acted {
    pub actions: Vec<Scored>,
}

/// A discrete action and its score.
#[derive(Serialize, ToSchema)]
pub struct Scored {
    pub index: usize,
    pub action: Vec<f64>,
    /// The higher, the likelier to solve the task.
    pub score: f32,
}

/// An evaluation to run.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EvaluateIn {
    /// Id of a world of the policy's family; attempts are counted there.
    pub world: String,
    /// Part of the family; default `test`.
    pub split: Option<SplitIn>,
    /// Most valid attempts a task, 1 to 100 (the default).
    pub attempts: Option<u64>,
    /// Decides which 10,000 discrete actions are ranked.
    pub seed: Option<u64>,
    /// For the policy `ranked`, which lives with the client: its order of actions, instead of a split.
    pub ranking: Option<Vec<RankingIn>>,
}

/// A task's actions in the order in which they are to be tried.
#[derive(Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RankingIn {
    /// Id of a task of the world.
    pub task: String,
    /// Action vectors, best first; more than 100 are of use where some cannot be placed.
    pub actions: Vec<Vec<f64>>,
}

/// Learning on in a world.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnIn {
    /// Id of a world of the policy's family; attempts are counted there.
    pub world: String,
    /// Random valid attempts to learn from; default: as many as the batches hold.
    pub attempts: Option<u64>,
    /// Updates; default 125.
    pub batches: Option<u64>,
    /// Examples per update, half of them solving; default 32.
    pub batch_size: Option<u64>,
    /// Adam's step size at the start; default 0.0005.
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

impl Bulk for Acted {}
impl Bulk for Policies {}
impl Bulk for PolicyOut {}
