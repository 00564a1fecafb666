//! Control tasks (`iplw.control/1`): mechanisms that are driven in many steps, with rewards, ends and a hidden real world.
//!
//! A task is one TOML file, or the same document in JSON. Values, observations, rewards and conditions are expressions over
//! `NAME`, `NAME_velocity` and `NAME_command` of each joint, `time` (s) and the numbers in `draws`; `values` are evaluated in
//! order.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use super::expression::Expression;
use super::joint::Motor;
use super::limits::check_name_length;
use super::scene::Scene;
use crate::error::{Error, Result, check_range};

/// The value of a control task's `format`.
pub const CONTROL_FORMAT: &str = "iplw.control/1";
/// Largest number of steps of an episode.
pub const MAX_EPISODE_STEPS: u32 = 100_000;
/// Largest number of simulation steps between two actions.
const MAX_SIMULATION_STEPS: f64 = 10_000.0;
/// Maximum number of draws, values and observations each.
const MAX_NUMBERS: usize = 64;
/// Largest magnitude of a number in a task.
const MAX_MAGNITUDE: f64 = 1e9;

/// A control task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlTask {
    /// [`CONTROL_FORMAT`]
    pub format: String,
    pub name: String,
    /// One sentence.
    #[serde(default)]
    pub about: String,
    /// Id of the Gymnasium environment; empty for tasks of users.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub gymnasium: String,
    /// A scene with joints and motors.
    pub scene: Scene,
    /// Time between actions, s: a multiple of the scene's time step.
    pub interval: f64,
    /// Duration after which an episode is truncated, s.
    pub time_limit: f64,
    /// Lowest and highest command of each motor, by joint.
    pub actions: BTreeMap<String, [f64; 2]>,
    /// Initial states of joints; those left out start as in the scene.
    #[serde(default)]
    pub initial: BTreeMap<String, InitialRange>,
    /// Numbers drawn uniformly at each reset.
    #[serde(default)]
    pub draws: BTreeMap<String, [f64; 2]>,
    /// Derived numbers: name and expression.
    #[serde(default)]
    pub values: Vec<(String, String)>,
    pub observations: Vec<ObservedNumber>,
    pub reward: Rewards,
    /// Condition that ends an episode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terminate: Option<String>,
    /// Condition reported as `success`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub success: Option<String>,
    /// How the real world differs from the scene.
    #[serde(default, skip_serializing_if = "ControlReality::is_none")]
    pub real: ControlReality,
}

/// Range of a joint's initial state: uniform from the first to the second number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InitialRange {
    /// rad or m
    pub position: [f64; 2],
    /// rad/s or m/s
    pub velocity: [f64; 2],
}

/// A number that an agent observes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservedNumber {
    pub name: String,
    pub value: String,
    /// Range, if it is bounded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
}

/// Rewards of a step, after it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rewards {
    pub dense: String,
    pub sparse: String,
}

/// Effects and noise of a world.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControlReality {
    pub effects: Vec<JointEffectRange>,
    /// Standard deviation of the noise of measured positions by joint, rad or m.
    pub noise: BTreeMap<String, f64>,
}

impl ControlReality {
    fn is_none(&self) -> bool {
        self.effects.is_empty() && self.noise.is_empty()
    }

    /// Checks the noise; `place` prefixes the field of an error.
    pub fn validate_noise<'a>(
        &self,
        joints: impl Iterator<Item = &'a String> + Clone,
        place: &str,
    ) -> Result<()> {
        self.noise.iter().try_for_each(|(joint, sd)| {
            let field = format!("{place}noise.{joint}");
            check_joint(&field, joint, joints.clone())?;
            check_range(&field, *sd, 0.0, MAX_MAGNITUDE).map(drop)
        })
    }
}

/// An effect in a joint whose parameters are numbers or ranges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointEffectRange {
    pub joint: String,
    pub name: String,
    #[serde(default)]
    pub parameters: BTreeMap<String, ValueOrRange>,
}

/// A number, or a range to draw it from uniformly.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum ValueOrRange {
    Value(f64),
    Uniform([f64; 2]),
}

impl ValueOrRange {
    /// Lowest and highest value.
    pub fn bounds(self) -> [f64; 2] {
        match self {
            ValueOrRange::Value(value) => [value, value],
            ValueOrRange::Uniform(range) => range,
        }
    }
}

/// Expressions of a task, over the numbers of [`ControlTask::names`] and then its values.
#[derive(Clone, Debug)]
pub struct ControlExpressions {
    pub values: Vec<Expression>,
    pub observations: Vec<Expression>,
    pub dense: Expression,
    pub sparse: Expression,
    pub terminate: Option<Expression>,
    pub success: Option<Expression>,
}

impl ControlTask {
    /// Parses and validates a TOML file.
    pub fn from_toml(text: &str) -> Result<ControlTask> {
        let task: ControlTask = toml::from_str(text)
            .map_err(|e| Error::input("", e.message().to_string(), format!("an {CONTROL_FORMAT} file")))?;
        task.validate()?;
        Ok(task)
    }

    /// Names in expressions, without those of `values`.
    fn names(&self) -> Vec<String> {
        let joints = &self.scene.joints;
        let of = |suffix: &'static str| joints.iter().map(move |joint| format!("{}{suffix}", joint.name));
        of("")
            .chain(of("_velocity"))
            .chain(of("_command"))
            .chain(["time".to_string()])
            .chain(self.draws.keys().cloned())
            .collect()
    }

    /// The parsed expressions; names are those of joints in the scene's order.
    pub fn expressions(&self) -> Result<ControlExpressions> {
        let mut names = self.names();
        for name in self.draws.keys() {
            if names.iter().filter(|other| *other == name).count() > 1 {
                return Err(Error::input(
                    format!("draws.{name}"),
                    "taken",
                    "a name that no other number has",
                ));
            }
        }
        let mut values = Vec::new();
        for (i, (name, text)) in self.values.iter().enumerate() {
            let field = format!("values[{i}]");
            values.push(Expression::parse(&field, text, &names)?);
            if names.contains(name) {
                return Err(Error::input(field, name.as_str(), "a name that no other number has"));
            }
            names.push(name.clone());
        }
        let parse = |field: &str, text: &str| Expression::parse(field, text, &names);
        let option =
            |field: &str, text: &Option<String>| text.as_ref().map(|text| parse(field, text)).transpose();
        let observed = self.observations.iter().enumerate();
        Ok(ControlExpressions {
            observations: observed
                .map(|(i, o)| parse(&format!("observations[{i}].value"), &o.value))
                .collect::<Result<_>>()?,
            dense: parse("reward.dense", &self.reward.dense)?,
            sparse: parse("reward.sparse", &self.reward.sparse)?,
            terminate: option("terminate", &self.terminate)?,
            success: option("success", &self.success)?,
            values,
        })
    }

    /// Checks every value; errors name the field.
    pub fn validate(&self) -> Result<()> {
        if self.format != CONTROL_FORMAT {
            return Err(Error::input("format", self.format.as_str(), CONTROL_FORMAT));
        }
        check_name_length("name", &self.name)?;
        self.scene.validate().map_err(|e| e.in_field("scene"))?;
        if self.scene.motors.is_empty() {
            return Err(Error::input("scene.motors", "none", "at least one motor"));
        }
        let step = self.scene.time_step;
        check_range("interval", self.interval, step, MAX_SIMULATION_STEPS * step)?;
        let steps = self.interval / step;
        if (steps - steps.round()).abs() > 1e-6 {
            return Err(Error::input(
                "interval",
                self.interval,
                format!("a multiple of time_step, {step} s"),
            ));
        }
        let longest = f64::from(MAX_EPISODE_STEPS) * self.interval;
        check_range("time_limit", self.time_limit, self.interval, longest)?;
        self.validate_actions()?;
        for (joint, range) in &self.initial {
            check_joint(&format!("initial.{joint}"), joint, self.joint_names())?;
            check_ordered(&format!("initial.{joint}.position"), range.position)?;
            check_ordered(&format!("initial.{joint}.velocity"), range.velocity)?;
        }
        for (name, range) in &self.draws {
            check_ordered(&format!("draws.{name}"), *range)?;
        }
        let counts = [
            ("draws", self.draws.len()),
            ("values", self.values.len()),
            ("observations", self.observations.len()),
        ];
        if let Some((field, count)) = counts.into_iter().find(|(_, count)| *count > MAX_NUMBERS) {
            return Err(Error::input(field, format!("{count} numbers"), format!("at most {MAX_NUMBERS}")));
        }
        if self.observations.is_empty() {
            return Err(Error::input("observations", "none", "at least one number"));
        }
        self.real.validate_noise(self.joint_names(), "real.")?;
        self.expressions().map(drop)
    }

    fn validate_actions(&self) -> Result<()> {
        for (joint, range) in &self.actions {
            check_ordered(&format!("actions.{joint}"), *range)?;
        }
        let motors = || self.scene.motors.iter().map(|m: &Motor| m.joint.as_str());
        if let Some(missing) = motors().find(|joint| !self.actions.contains_key(*joint)) {
            return Err(Error::input(format!("actions.{missing}"), "missing", "a range for each motor"));
        }
        match self.actions.keys().find(|joint| !motors().any(|m| m == **joint)) {
            Some(other) => {
                let allowed = format!("joints with a motor: {}", motors().collect::<Vec<_>>().join(", "));
                Err(Error::input(format!("actions.{other}"), "no motor", allowed))
            }
            None => Ok(()),
        }
    }

    fn joint_names(&self) -> impl Iterator<Item = &String> + Clone {
        self.scene.joints.iter().map(|joint| &joint.name)
    }
}

/// Checks that a joint exists.
fn check_joint<'a>(
    field: &str,
    name: &str,
    mut joints: impl Iterator<Item = &'a String> + Clone,
) -> Result<()> {
    let known = joints.clone();
    if joints.any(|joint| joint == name) {
        return Ok(());
    }
    let known: Vec<&str> = known.map(String::as_str).collect();
    Err(Error::input(field, "no joint", format!("joints {}", known.join(", "))))
}

/// Checks that a range is finite and not empty.
fn check_ordered(field: &str, [low, high]: [f64; 2]) -> Result<()> {
    check_range(field, low, -MAX_MAGNITUDE, MAX_MAGNITUDE)?;
    check_range(field, high, low, MAX_MAGNITUDE).map(drop)
}

/// The files of the built-in tasks.
static BUILT_IN: [&str; 6] = [
    include_str!("pendulum_swing_up.toml"),
    include_str!("cart_pole_balance.toml"),
    include_str!("cart_pole_swing_up.toml"),
    include_str!("acrobot.toml"),
    include_str!("reacher.toml"),
    include_str!("ball_on_beam.toml"),
];

/// The built-in control tasks.
pub fn control_tasks() -> &'static [ControlTask] {
    static TASKS: OnceLock<Vec<ControlTask>> = OnceLock::new();
    TASKS.get_or_init(|| {
        let read = |text: &&str| ControlTask::from_toml(text).expect("built-in tasks are valid: tested");
        BUILT_IN.iter().map(read).collect()
    })
}

/// The built-in control task named `name`.
pub fn control_task(name: &str) -> Result<&'static ControlTask> {
    let all = control_tasks();
    let found = all.iter().find(|task| task.name == name);
    found.ok_or_else(|| Error::not_found("control task", name, all.iter().map(|task| task.name.as_str())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_tasks_are_valid() {
        assert_eq!(control_tasks().len(), BUILT_IN.len());
        assert!(control_tasks().iter().all(|t| t.gymnasium.starts_with("iplw/") && !t.real.is_none()));
    }

    #[test]
    fn errors_name_the_field() {
        let refused = |change: &dyn Fn(&mut ControlTask), field: &str| {
            let mut task = control_tasks()[0].clone();
            change(&mut task);
            let error = task.validate().unwrap_err().to_string();
            assert!(error.contains(field), "{error} for {field}");
        };
        refused(&|t| t.interval = 0.0033, "interval");
        refused(&|t| t.time_limit = 0.0, "time_limit");
        refused(&|t| t.reward.dense = "hinge +".into(), "reward.dense");
        refused(&|t| t.actions.clear(), "actions.hinge");
        refused(&|t| t.actions.extend([("other".into(), [0.0, 1.0])]), "actions.other");
        refused(&|t| t.draws.extend([("goal".into(), [1.0, 0.0])]), "draws.goal");
        refused(&|t| t.draws.extend([("hinge_velocity".into(), [0.0, 1.0])]), "draws.hinge_velocity");
        refused(&|t| t.terminate = Some("elbow > 1".into()), "terminate");
        refused(&|t| t.scene.motors.clear(), "scene.motors");
    }
}
