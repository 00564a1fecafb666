//! An episode: Gymnasium's reset and step.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::action::ActionIn;
use super::array::{Array, Data};
use super::bulk::Bulk;
use crate::session::{Reset, Start, Step};
use crate::task::Split;
use crate::trajectory::End;

/// What to reset to; everything may be absent.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ResetIn {
    /// Starts the world's sequence of tasks anew.
    pub seed: Option<u64>,
    /// Id of the task; drawn from the sequence if absent.
    pub task: Option<String>,
    /// Part of the family to draw from; `train` if absent.
    pub split: Option<SplitIn>,
}

/// Part of a family.
#[derive(Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SplitIn {
    Train,
    Validation,
    Test,
}

/// The start of an episode.
#[derive(Serialize, ToSchema)]
pub struct ResetOut {
    /// Each from 0 to 1, as the world's `observation_space` names them.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<f64>, required = true)]
    pub observation: Option<Array>,
    pub info: ResetInfo,
}

/// What else there is to know after a reset.
#[derive(Serialize, ToSchema)]
pub struct ResetInfo {
    pub task: String,
    pub split: SplitIn,
}

/// One action.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StepIn {
    pub action: ActionIn,
}

/// Gymnasium's tuple.
#[derive(Serialize, ToSchema)]
pub struct StepOut {
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<f64>, required = true)]
    pub observation: Option<Array>,
    /// 1 if the task was solved, else 0.
    pub reward: f64,
    pub terminated: bool,
    /// Always false: a task takes one action.
    pub truncated: bool,
    pub info: StepInfo,
}

/// What else there is to know after a step.
#[derive(Serialize, ToSchema)]
pub struct StepInfo {
    /// Whether the action could be placed; if not, it was no attempt and the episode goes on.
    pub valid: bool,
    /// Why it could not be placed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    pub solved: bool,
    /// Simulated time steps.
    pub steps: u32,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// Begun contacts between movable bodies.
    pub collisions: u32,
    /// Time steps that bodies spent on a surface, summed.
    pub rolling_steps: u32,
    /// `horizon`, `goal` or `diverged`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end: Option<&'static str>,
}

impl From<SplitIn> for Split {
    fn from(split: SplitIn) -> Split {
        match split {
            SplitIn::Train => Split::Train,
            SplitIn::Validation => Split::Validation,
            SplitIn::Test => Split::Test,
        }
    }
}

impl From<Split> for SplitIn {
    fn from(split: Split) -> SplitIn {
        match split {
            Split::Train => SplitIn::Train,
            Split::Validation => SplitIn::Validation,
            Split::Test => SplitIn::Test,
        }
    }
}

impl From<ResetIn> for Reset {
    fn from(reset: ResetIn) -> Reset {
        Reset { seed: reset.seed, task: reset.task, split: reset.split.map(Split::from) }
    }
}

impl From<Start> for ResetOut {
    fn from(start: Start) -> ResetOut {
        ResetOut {
            observation: Some(Array::line(Data::F8(start.observation))),
            info: ResetInfo { task: start.task, split: start.split.into() },
        }
    }
}

impl From<Step> for StepOut {
    fn from(step: Step) -> StepOut {
        StepOut {
            observation: Some(Array::line(Data::F8(step.observation))),
            reward: step.reward,
            terminated: step.terminated,
            truncated: false,
            info: StepInfo {
                valid: step.invalid.is_none(),
                reason: step.invalid,
                solved: step.solved,
                steps: step.steps,
                task: step.task,
                interactions: step.interactions,
                collisions: step.collisions,
                rolling_steps: step.rolling_steps,
                end: step.end.map(end_name),
            },
        }
    }
}

/// The word for how a rollout ended.
pub fn end_name(end: End) -> &'static str {
    match end {
        End::Horizon => "horizon",
        End::Goal => "goal",
        End::Diverged => "diverged",
        End::Blocked { .. } => "blocked",
    }
}

impl Bulk for ResetOut {
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        self.observation.take().map(|a| ("observation", a)).into_iter().collect()
    }
}

impl Bulk for StepOut {
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        self.observation.take().map(|a| ("observation", a)).into_iter().collect()
    }
}
