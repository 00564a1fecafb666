//! Control worlds: creation, reset, step and rollouts.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::array::{Array, ArrayData};
use super::binary_arrays::BinaryArrays;
use crate::control::{ControlModel, ControlOutcome, ControlStep, ControlWorld, RewardKind};
use crate::error::{Error, Result};
use crate::json::JsonObject;
use crate::session::{Autoreset, WorldKind};
use crate::task::Scene;
use crate::task::control::{ControlReality, ControlTask, JointEffectRange, control_task};

/// A control world to create. Requires either `task` or `definition`.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateControlWorld {
    /// Name of a built-in task.
    pub task: Option<String>,
    /// An `iplw.control/1` document.
    #[schema(value_type = Option<Object>)]
    pub definition: Option<JsonObject<ControlTask>>,
    /// Default: `sim`. A real world has the task's hidden physics.
    pub kind: Option<WorldKind>,
    /// Number of environments. Default: 1.
    #[schema(minimum = 1, maximum = 4096)]
    pub count: Option<usize>,
    /// Default: `dense`.
    pub reward: Option<RewardKind>,
    /// Physics beside the scene's, of a simulated world. Default: none.
    #[schema(value_type = Option<PhysicsIn>)]
    pub physics: Option<JsonObject<PhysicsIn>>,
    pub seed: Option<u64>,
}

/// Effects in joints, with numbers or ranges that are drawn at each reset, and noise.
#[derive(Clone, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PhysicsIn {
    /// Each with `joint`, `name` and `parameters` by name: a number, or `[low, high]`.
    #[schema(value_type = Option<Vec<Object>>)]
    pub effects: Option<Vec<JsonObject<JointEffectRange>>>,
    /// Standard deviation of the noise of measured positions by joint, rad or m.
    pub noise: Option<BTreeMap<String, f64>>,
}

impl PhysicsIn {
    pub fn reality(self) -> ControlReality {
        ControlReality {
            effects: self.effects.into_iter().flatten().map(|e| e.0).collect(),
            noise: self.noise.unwrap_or_default(),
        }
    }
}

impl CreateControlWorld {
    /// The task that the world is of.
    pub fn model(&mut self) -> Result<ControlModel> {
        match (self.task.take(), self.definition.take()) {
            (Some(name), None) => ControlModel::new(control_task(&name)?.clone()),
            (None, Some(JsonObject(task))) => ControlModel::new(task).map_err(|e| e.in_field("definition")),
            (Some(_), Some(_)) => {
                Err(Error::input("definition", "given together with `task`", "one of task and definition"))
            }
            (None, None) => Err(Error::input("task", "missing", "one of task and definition")),
        }
    }
}

/// A control world.
#[derive(Serialize, ToSchema)]
pub struct ControlWorldOut {
    pub id: String,
    pub task: ControlTaskOut,
    pub kind: WorldKind,
    /// Number of environments.
    pub count: usize,
    pub reward: RewardKind,
    pub seed: u64,
    pub usage: ControlUsageOut,
}

/// Interactions with a control world.
#[derive(Serialize, ToSchema)]
pub struct ControlUsageOut {
    /// Motion of all environments, s.
    pub motion_seconds: f64,
    pub resets: u64,
    pub steps: u64,
}

/// A control task, without its hidden physics.
#[derive(Serialize, ToSchema)]
pub struct ControlTaskOut {
    pub name: String,
    pub about: String,
    /// Id of the Gymnasium environment; empty for tasks of users.
    pub gymnasium: String,
    /// Time between actions and time limit of an episode, s.
    pub interval: f64,
    pub time_limit: f64,
    /// Joints with motors, in the order of actions, and the ranges of their commands.
    pub actions: Vec<RangeOut>,
    /// Numbers of an observation; `null` where a range is unbounded.
    pub observations: Vec<RangeOut>,
    /// Joints in the order of measured positions.
    pub joints: Vec<String>,
    /// An `iplw.scene/2` document.
    #[schema(value_type = Object)]
    pub scene: Scene,
}

/// A named number with its range.
#[derive(Serialize, ToSchema)]
pub struct RangeOut {
    pub name: String,
    pub low: Option<f64>,
    pub high: Option<f64>,
}

/// The built-in control tasks.
#[derive(Serialize, ToSchema)]
pub struct ControlTasksOut {
    pub tasks: Vec<ControlTaskOut>,
}

impl From<&ControlTask> for ControlTaskOut {
    fn from(task: &ControlTask) -> ControlTaskOut {
        let action = |joint: &String| {
            let [low, high] = task.actions[joint];
            RangeOut { name: joint.clone(), low: Some(low), high: Some(high) }
        };
        let observed = task.observations.iter().map(|o| RangeOut {
            name: o.name.clone(),
            low: o.range.map(|r| r[0]),
            high: o.range.map(|r| r[1]),
        });
        ControlTaskOut {
            name: task.name.clone(),
            about: task.about.clone(),
            gymnasium: task.gymnasium.clone(),
            interval: task.interval,
            time_limit: task.time_limit,
            actions: task.scene.motors.iter().map(|m| action(&m.joint)).collect(),
            observations: observed.collect(),
            joints: task.scene.joints.iter().map(|j| j.name.clone()).collect(),
            scene: task.scene.clone(),
        }
    }
}

impl ControlWorldOut {
    pub fn new(id: &str, world: &ControlWorld) -> ControlWorldOut {
        let config = &world.config;
        let usage = world.usage;
        ControlWorldOut {
            id: id.into(),
            task: ControlTaskOut::from(&config.model.task),
            kind: config.kind,
            count: config.count,
            reward: config.reward,
            seed: config.seed,
            usage: ControlUsageOut {
                motion_seconds: usage.motion_seconds,
                resets: usage.resets,
                steps: usage.steps,
            },
        }
    }
}

/// Starts episodes.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ControlResetIn {
    /// Starts the sequences of the environments anew; without it they continue.
    pub seed: Option<u64>,
    /// Environments to reset. Default: all.
    pub mask: Option<Vec<bool>>,
}

/// An action for each environment.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ControlStepIn {
    /// By environment, one number per motor; clipped to the motor's range.
    pub actions: Vec<Vec<f64>>,
    /// Default: `disabled`.
    pub autoreset: Option<Autoreset>,
}

/// Sequences of actions to simulate from an environment's state, which does not change.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ControlRolloutIn {
    /// Default: 0.
    pub environment: Option<usize>,
    /// By sequence and step, one number per motor.
    pub actions: Vec<Vec<Vec<f64>>>,
}

/// First observations of episodes.
#[derive(Serialize, ToSchema)]
pub struct ControlResetOut {
    /// By environment; zeros where it was not reset.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<f64>>, required = true)]
    pub observation: Option<Array>,
    /// Measured joint positions by environment, rad or m.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<f64>>, required = true)]
    pub position: Option<Array>,
}

/// Results of a step by environment.
#[derive(Serialize, ToSchema)]
pub struct ControlStepOut {
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<f64>>, required = true)]
    pub observation: Option<Array>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<f64>, required = true)]
    pub reward: Option<Array>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub terminated: Option<Array>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub truncated: Option<Array>,
    /// The task's condition of success; false without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub success: Option<Array>,
    /// Whether the environment was reset instead of stepped.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub reset: Option<Array>,
    /// Measured joint positions, rad or m, and actual velocities.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<f64>>, required = true)]
    pub position: Option<Array>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<f64>>, required = true)]
    pub velocity: Option<Array>,
    /// With `same_step`: observations at the ends of episodes, zeros elsewhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Vec<f64>>>)]
    pub final_observation: Option<Array>,
    /// Motion of all environments so far, s.
    pub motion_seconds: f64,
}

/// Results of rollouts by sequence.
#[derive(Serialize, ToSchema)]
pub struct ControlRolloutOut {
    /// Reward of each step; 0 after the end of an episode, `null` (minus infinity in a binary array) where a motion diverges.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<Option<f64>>>, required = true)]
    pub reward: Option<Array>,
    /// Number of steps until the end of the episode or of the sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<u32>, required = true)]
    pub steps: Option<Array>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub terminated: Option<Array>,
    /// Observation at the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<f64>>, required = true)]
    pub observation: Option<Array>,
}

fn flags(values: impl Iterator<Item = bool>) -> Option<Array> {
    Some(Array::line(ArrayData::Bool(values.collect())))
}

impl ControlResetOut {
    pub fn new(outcomes: Vec<Option<ControlOutcome>>, model: &ControlModel) -> ControlResetOut {
        let rows = |of: fn(&ControlOutcome) -> &Vec<f64>, width: usize| {
            let row =
                |o: &Option<ControlOutcome>| o.as_ref().map_or_else(|| vec![0.0; width], |o| of(o).clone());
            Some(Array::rows(outcomes.iter().map(row).collect()))
        };
        ControlResetOut {
            observation: rows(|o| &o.observation, model.task.observations.len()),
            position: rows(|o| &o.positions, model.task.scene.joints.len()),
        }
    }
}

impl ControlStepOut {
    pub fn new(steps: Vec<ControlStep>, autoreset: Autoreset, motion_seconds: f64) -> ControlStepOut {
        let outcomes = || steps.iter().map(|s| &s.outcome);
        let rows = |of: fn(&ControlOutcome) -> &Vec<f64>| {
            Some(Array::rows(outcomes().map(|o| of(o).clone()).collect()))
        };
        let width = steps[0].outcome.observation.len();
        let ended = |s: &ControlStep| s.final_observation.clone().unwrap_or_else(|| vec![0.0; width]);
        let reward = steps.iter().map(|s| if s.was_reset { 0.0 } else { s.outcome.reward }).collect();
        ControlStepOut {
            observation: rows(|o| &o.observation),
            reward: Some(Array::line(ArrayData::F8(reward))),
            terminated: flags(steps.iter().map(|s| !s.was_reset && s.outcome.terminated)),
            truncated: flags(steps.iter().map(|s| !s.was_reset && s.outcome.truncated)),
            success: flags(outcomes().map(|o| o.success == Some(true))),
            reset: flags(steps.iter().map(|s| s.was_reset)),
            position: rows(|o| &o.positions),
            velocity: rows(|o| &o.velocities),
            final_observation: (autoreset == Autoreset::SameStep)
                .then(|| Array::rows(steps.iter().map(ended).collect())),
            motion_seconds,
        }
    }
}

impl ControlRolloutOut {
    pub fn new(rolled: &[Vec<ControlOutcome>], longest: usize) -> ControlRolloutOut {
        let reward = |own: &Vec<ControlOutcome>| {
            let each = own.iter().map(|o| o.reward).chain(std::iter::repeat(0.0));
            each.take(longest).collect::<Vec<f64>>()
        };
        let last = || rolled.iter().filter_map(|own| own.last());
        ControlRolloutOut {
            reward: Some(Array::rows(rolled.iter().map(reward).collect())),
            steps: Some(Array::line(ArrayData::U4(rolled.iter().map(|own| own.len() as u32).collect()))),
            terminated: flags(last().map(|o| o.terminated)),
            observation: Some(Array::rows(last().map(|o| o.observation.clone()).collect())),
        }
    }
}

/// Arrays that are present, by name.
fn present<const N: usize>(all: [(&'static str, &mut Option<Array>); N]) -> Vec<(&'static str, Array)> {
    all.into_iter().filter_map(|(name, array)| Some((name, array.take()?))).collect()
}

impl BinaryArrays for ControlWorldOut {}
impl BinaryArrays for ControlTasksOut {}

impl BinaryArrays for ControlResetOut {
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        present([("observation", &mut self.observation), ("position", &mut self.position)])
    }
}

impl BinaryArrays for ControlStepOut {
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        present([
            ("observation", &mut self.observation),
            ("reward", &mut self.reward),
            ("terminated", &mut self.terminated),
            ("truncated", &mut self.truncated),
            ("success", &mut self.success),
            ("reset", &mut self.reset),
            ("position", &mut self.position),
            ("velocity", &mut self.velocity),
            ("final_observation", &mut self.final_observation),
        ])
    }
}

impl BinaryArrays for ControlRolloutOut {
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        present([
            ("reward", &mut self.reward),
            ("steps", &mut self.steps),
            ("terminated", &mut self.terminated),
            ("observation", &mut self.observation),
        ])
    }
}
