//! `iplw.scene/1` and `/2`: bodies, statics, joints, goal and action space as plain data.
//!
//! SI units, y up, angles counter-clockwise. [`Scene::from_json`] parses and validates; [`Scene::validate`]
//! checks a `Scene` built in code. The dynamics are in `world/`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::action::ActionSpace;
pub use super::body::{Body, Inertia, RoundBody, Static};
pub use super::contact_rules::{ContactRules, FrictionRule, MAX_RESTITUTION_THRESHOLD_M_S, RestitutionRule};
pub use super::effect_term::EffectTerm;
use super::geometry::{Aabb, union_box};
pub use super::goal::{Goal, GoalPoint};
use super::intervention::Intervention;
use super::joint::{Joint, Motor};
pub use super::setting::{BodyOverride, Setting, StaticOverride};
pub use super::shape::Shape;
use crate::error::{Error, Result};

/// The value of a scene's `format` field, and of one with joints.
pub const FORMAT: &str = "iplw.scene/1";
pub const JOINT_FORMAT: &str = "iplw.scene/2";

/// A 2D scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// [`FORMAT`], or [`JOINT_FORMAT`], which also has joints and motors.
    pub format: String,
    /// Free text.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// Acceleration, m/s^2.
    #[serde(default = "default_gravity")]
    pub gravity: [f64; 2],
    /// Movable bodies; all share the task's latent factors unless `carriers` lists others.
    pub bodies: Vec<Body>,
    /// Objects that never move.
    #[serde(default)]
    pub statics: Vec<Static>,
    /// Joints and their motors.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<Joint>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub motors: Vec<Motor>,
    /// Effects beyond gravity and contact; names and parameters as `world::effect` registers them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectTerm>,
    /// Fraction of the velocity kept per second, (0, 1]; shorthand for the effect `linear_drag`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damping: Option<f64>,
    /// Mixing rules for friction and restitution; products without a restitution threshold if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_rules: Option<ContactRules>,
    /// s
    #[serde(default = "default_time_step")]
    pub time_step: f64,
    /// Number of time steps of a full rollout.
    #[serde(default = "default_steps")]
    pub steps: u32,
    /// Observation interval in time steps; the start and the end are always observed.
    #[serde(default = "default_observe_every")]
    pub observe_every: u32,
    /// The goal, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal: Option<Goal>,
    /// `false` lets a rollout continue after the goal is reached.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop: Option<bool>,
    /// The action space; makes the scene a task.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action: Option<ActionSpace>,
    /// Names of the bodies and statics that carry the latent factors; all movable bodies if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub carriers: Option<Vec<String>>,
    /// Latent factors to estimate from trials.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub calibrate: Vec<String>,
    /// Quantities that may differ between settings of measured trials.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub per_setting: Vec<String>,
    /// Overrides of body and static fields, by setting.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub settings: BTreeMap<String, Setting>,
    /// Interventions of a rollout. Not part of the document: a rollout request supplies them.
    #[serde(skip)]
    pub interventions: Vec<Intervention>,
}

impl Scene {
    /// Times at which a full rollout is observed, the start and the end included, s.
    pub fn observation_times(&self) -> Vec<f64> {
        let steps = (0..self.steps).step_by(self.observe_every as usize).chain([self.steps]);
        steps.map(|step| f64::from(step) * self.time_step).collect()
    }

    /// Parses and validates a scene; errors name the field's path.
    pub fn from_json(text: &str) -> Result<Scene> {
        let scene: Scene = crate::json::parse(text)?;
        scene.validate()?;
        Ok(scene)
    }

    /// An empty scene with default values, to be filled; not valid until it has a body.
    pub fn empty() -> Scene {
        Scene {
            format: FORMAT.into(),
            name: String::new(),
            gravity: default_gravity(),
            bodies: Vec::new(),
            statics: Vec::new(),
            joints: Vec::new(),
            motors: Vec::new(),
            effects: Vec::new(),
            damping: None,
            contact_rules: None,
            time_step: default_time_step(),
            steps: default_steps(),
            observe_every: default_observe_every(),
            goal: None,
            stop: None,
            action: None,
            carriers: None,
            calibrate: Vec::new(),
            per_setting: Vec::new(),
            settings: BTreeMap::new(),
            interventions: Vec::new(),
        }
    }

    /// Errors if the scene has joints, which simulations with contacts do not have.
    pub fn check_without_joints(&self) -> Result<()> {
        if self.joints.is_empty() {
            return Ok(());
        }
        let allowed = "no joints here; `iplw rollout` and `iplw diagnose` take scenes with joints";
        Err(Error::input("joints", format!("{} joints", self.joints.len()), allowed))
    }

    /// The scene as pretty JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a scene is always representable as JSON")
    }

    /// The body named `name`.
    pub fn body(&self, name: &str) -> Option<&Body> {
        self.bodies.iter().find(|b| b.name == name)
    }

    /// Whether `name` carries the latent factors.
    pub fn carries_latents(&self, name: &str) -> bool {
        match &self.carriers {
            Some(names) => names.iter().any(|n| n == name),
            None => self.body(name).is_some(),
        }
    }

    /// The scene with these latents, density (kg/m^2), friction and restitution, in all that carries them.
    pub fn with_carriers(mut self, [density, friction, restitution]: [f64; 3]) -> Scene {
        let carries: Vec<bool> = self.bodies.iter().map(|b| self.carries_latents(&b.name)).collect();
        for (body, _) in self.bodies.iter_mut().zip(carries).filter(|(_, carries)| *carries) {
            (body.mass, body.density) = (None, Some(density));
            (body.friction, body.restitution) = (friction, restitution);
        }
        let carries: Vec<bool> = self.statics.iter().map(|s| self.carries_latents(&s.name)).collect();
        for (fixed, _) in self.statics.iter_mut().zip(carries).filter(|(_, carries)| *carries) {
            (fixed.friction, fixed.restitution) = (friction, restitution);
        }
        self
    }

    /// Whether a rollout ends when the goal is reached.
    pub fn stops_at_goal(&self) -> bool {
        self.goal.as_ref().is_some_and(Goal::stops) && self.stop != Some(false)
    }

    /// The scene without its settings, as used for the scenes of trials.
    pub fn without_settings(&self) -> Scene {
        Scene { settings: BTreeMap::new(), ..self.clone() }
    }

    /// The scene with a setting's overrides applied.
    pub fn with_setting(&self, overrides: Option<&Setting>) -> Scene {
        let mut scene = self.clone();
        if let Some(overrides) = overrides {
            overrides.apply(&mut scene.bodies, &mut scene.statics);
        }
        scene
    }

    /// Axis-aligned box around all bounded objects, widened by 2 %; for drawing.
    pub fn extent(&self) -> Aabb {
        let bodies = self.bodies.iter().filter_map(|b| Some(b.placed()?.bounds()));
        let statics = self.statics.iter().filter_map(|s| s.placed().bounds());
        let given = self.action.as_ref().and_then(|a| a.bounds);
        let all = given.into_iter().chain(bodies).chain(statics).reduce(union_box);
        let b = all.unwrap_or([-1.0, -1.0, 1.0, 1.0]);
        let pad = 0.02 * (b[2] - b[0]).max(b[3] - b[1]).max(1e-3);
        [b[0] - pad, b[1] - pad, b[2] + pad, b[3] + pad]
    }

    /// Errors unless `name` is a body (or a static, if `statics` is set).
    pub(crate) fn check_name(&self, field: &str, name: &str, statics: bool) -> Result<()> {
        let bodies = self.bodies.iter().map(|b| &b.name);
        let fixed = self.statics.iter().map(|s| &s.name).filter(|_| statics);
        let known: Vec<&String> = bodies.chain(fixed).collect();
        if known.iter().any(|k| *k == name) {
            return Ok(());
        }
        let known = known.iter().map(|k| format!("{k:?}")).collect::<Vec<_>>().join(", ");
        Err(Error::input(field, format!("{name:?}"), format!("one of {known}")))
    }
}

fn default_gravity() -> [f64; 2] {
    [0.0, -9.8]
}
fn default_time_step() -> f64 {
    1.0 / 240.0
}
fn default_steps() -> u32 {
    4000
}
fn default_observe_every() -> u32 {
    60
}
