//! Episodes: Gymnasium's reset and step.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::array::{Array, ArrayData};
use super::binary_arrays::BinaryArrays;
use crate::session::{Action, EpisodeStart, StepResult};
use crate::task::Split;
use crate::trajectory::Termination;

/// The start of an episode.
#[derive(Serialize, ToSchema)]
pub struct ResetOut {
    /// Values from 0 to 1; the world's `observation_space` names them.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<f64>, required = true)]
    pub observation: Option<Array>,
    pub info: ResetInfo,
}

/// Gymnasium's info of a reset.
#[derive(Serialize, ToSchema)]
pub struct ResetInfo {
    pub task: String,
    pub split: Split,
    /// Number of the episode in this world, from 1; a step that names it is rejected after another reset.
    pub episode: u64,
}

/// One action.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StepIn {
    pub action: Action,
    /// Number of the episode, from the info of its reset; 409 if another reset has ended it. Default: the current episode.
    pub episode: Option<u64>,
}

/// Gymnasium's result of a step.
#[derive(Serialize, ToSchema)]
pub struct StepOut {
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<f64>, required = true)]
    pub observation: Option<Array>,
    /// 0 if the task was not solved; else the episode's AUCCESS, 1 at the first attempt.
    pub reward: f64,
    /// Whether the task is solved, or all attempts are used.
    pub terminated: bool,
    /// Always false: the number of attempts is part of the task.
    pub truncated: bool,
    pub info: StepInfo,
}

/// Gymnasium's info of a step.
#[derive(Serialize, ToSchema)]
pub struct StepInfo {
    /// Whether the action could be placed; if not, it is not counted and the episode continues.
    pub valid: bool,
    /// Why it could not be placed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    pub solved: bool,
    /// Valid attempts in the episode so far.
    pub attempt: u32,
    /// Simulated time steps.
    pub steps: u32,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// Number of contacts between movable bodies.
    pub collisions: u32,
    /// Time steps that bodies spent on a surface, summed over bodies.
    pub rolling_steps: u32,
    /// `horizon`, `goal` or `diverged`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end: Option<&'static str>,
}

impl From<EpisodeStart> for ResetOut {
    fn from(start: EpisodeStart) -> ResetOut {
        ResetOut {
            observation: Some(Array::line(ArrayData::F8(start.observation))),
            info: ResetInfo { task: start.task, split: start.split, episode: start.episode },
        }
    }
}

impl From<StepResult> for StepOut {
    fn from(step: StepResult) -> StepOut {
        StepOut {
            observation: Some(Array::line(ArrayData::F8(step.observation))),
            reward: step.reward,
            terminated: step.terminated,
            truncated: false,
            info: StepInfo {
                valid: step.invalid.is_none(),
                reason: step.invalid,
                solved: step.solved,
                attempt: step.attempt,
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

/// Wire name of a rollout's termination.
pub fn end_name(end: Termination) -> &'static str {
    match end {
        Termination::Horizon => "horizon",
        Termination::Goal => "goal",
        Termination::Diverged => "diverged",
        Termination::Blocked { .. } => "blocked",
    }
}

impl BinaryArrays for ResetOut {
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        self.observation.take().map(|a| ("observation", a)).into_iter().collect()
    }
}

impl BinaryArrays for StepOut {
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        self.observation.take().map(|a| ("observation", a)).into_iter().collect()
    }
}
