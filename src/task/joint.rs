//! Joints between bodies and motors on joints (`iplw.scene/2`).
//!
//! A joint's position is 0 in the scene's configuration. Revolute joints have rad, N m and rad/s; prismatic joints m, N
//! and m/s in their places.

use serde::{Deserialize, Serialize};

use super::effect_term::EffectTerm;
use super::limits::{MAX_LENGTH_M, check_name_length, check_vector};
use crate::error::{Error, Result, check_range};
use crate::names::names;

/// Maximum number of joints of a scene.
pub const MAX_JOINTS: usize = 8;
/// Largest torque or force, gain, armature and initial velocity.
const MAX_TORQUE: f64 = 1e6;
const MAX_ARMATURE: f64 = 1e6;
const MAX_GAIN: f64 = 1e6;
const MAX_VELOCITY: f64 = 1e3;

/// A joint by which a body hangs on another body or on the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// Unique among joints.
    pub name: String,
    pub kind: JointKind,
    /// The body that it moves.
    pub body: String,
    /// The body that it hangs on; the world if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<String>,
    /// Position of the joint in the scene's configuration, m.
    pub anchor: [f64; 2],
    /// Direction of a prismatic joint in the scene's configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 2]>,
    /// Initial position and velocity.
    #[serde(default)]
    pub position: f64,
    #[serde(default)]
    pub velocity: f64,
    /// Inertia of what turns with the joint alone, such as a rotor behind gears or a ball that rolls along a beam: kg m^2, or kg.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub armature: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spring: Option<Spring>,
    /// Stops at both ends of the positions; the joint moves freely without them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<JointLimits>,
    /// Effects in this joint: see `world::mechanism::effect`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectTerm>,
}

/// A spring and damper in a joint: torque -stiffness (q - rest) - damping v.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spring {
    /// N m/rad
    pub stiffness: f64,
    /// N m s/rad
    #[serde(default)]
    pub damping: f64,
    /// Position at which the spring is relaxed, rad.
    #[serde(default)]
    pub rest: f64,
}

/// Stops of a joint: torque -stiffness x (1 + damping v) at a depth x beyond an end, v the velocity towards it; never one that pulls.
///
/// Source: Hunt and Crossley, Journal of Applied Mechanics 42 (1975) 440, with the exponent 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointLimits {
    /// rad
    pub low: f64,
    pub high: f64,
    /// N m/rad; if absent as stiff as the time step allows with a margin: all that hangs on the joint, as one rigid body, would oscillate on it
    /// with 0.2 rad in a step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<f64>,
    /// s/rad
    #[serde(default = "default_stop_damping")]
    pub damping: f64,
}

/// Damping of stops by default, s/rad.
pub const DEFAULT_STOP_DAMPING: f64 = 1.0;

fn default_stop_damping() -> f64 {
    DEFAULT_STOP_DAMPING
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// The motion that a joint allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointKind {
    /// Rotation about the anchor.
    Revolute,
    /// Translation along the axis.
    Prismatic,
}

names!(JointKind: Revolute = "revolute", Prismatic = "prismatic");

/// A motor on a joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    pub joint: String,
    pub control: Control,
    /// Torque per rad of position error (N m/rad): of position control.
    #[serde(default)]
    pub stiffness: f64,
    /// Torque per rad/s of velocity error (N m s/rad): of velocity control, and damping of position control.
    #[serde(default)]
    pub damping: f64,
    /// Largest torque, N m.
    #[serde(default = "default_max_torque")]
    pub max_torque: f64,
}

/// The quantity that a motor's command sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Control {
    Torque,
    Velocity,
    Position,
}

names!(Control: Torque = "torque", Velocity = "velocity", Position = "position");

fn default_max_torque() -> f64 {
    MAX_TORQUE
}

impl Joint {
    /// Checks every value; errors name the field.
    pub(super) fn validate(&self) -> Result<()> {
        check_name_length("name", &self.name)?;
        check_vector("anchor", self.anchor, MAX_LENGTH_M)?;
        check_range("position", self.position, -MAX_LENGTH_M, MAX_LENGTH_M)?;
        check_range("velocity", self.velocity, -MAX_VELOCITY, MAX_VELOCITY)?;
        check_range("armature", self.armature, 0.0, MAX_ARMATURE)?;
        if let Some(spring) = &self.spring {
            check_range("spring.stiffness", spring.stiffness, 0.0, MAX_GAIN)?;
            check_range("spring.damping", spring.damping, 0.0, MAX_GAIN)?;
            check_range("spring.rest", spring.rest, -MAX_LENGTH_M, MAX_LENGTH_M)?;
        }
        if let Some(limits) = &self.limits {
            check_range("limits.low", limits.low, -MAX_LENGTH_M, MAX_LENGTH_M)?;
            check_range("limits.high", limits.high, -MAX_LENGTH_M, MAX_LENGTH_M)?;
            if limits.high <= limits.low {
                return Err(Error::input("limits.high", limits.high, format!("above low, {}", limits.low)));
            }
            check_range("limits.stiffness", limits.stiffness.unwrap_or(0.0), 0.0, MAX_GAIN)?;
            check_range("limits.damping", limits.damping, 0.0, MAX_GAIN)?;
        }
        match (self.kind, self.axis) {
            (JointKind::Prismatic, Some([x, y])) if x.hypot(y) > 1e-9 && x.hypot(y).is_finite() => Ok(()),
            (JointKind::Revolute, None) => Ok(()),
            (JointKind::Prismatic, axis) => Err(Error::input(
                "axis",
                format!("{axis:?}"),
                "the direction of the prismatic joint, not zero",
            )),
            (JointKind::Revolute, _) => Err(Error::input("axis", "given", "absent for a revolute joint")),
        }
    }
}

impl Motor {
    /// Whether the scene states a largest torque.
    pub fn has_limit(&self) -> bool {
        self.max_torque < MAX_TORQUE
    }

    /// Torque for a command at a position and velocity, within the limit, N m.
    pub fn torque(&self, command: f64, position: f64, velocity: f64) -> f64 {
        let free = match self.control {
            Control::Torque => command,
            Control::Velocity => self.damping * (command - velocity),
            Control::Position => self.stiffness * (command - position) - self.damping * velocity,
        };
        free.clamp(-self.max_torque, self.max_torque)
    }

    /// Checks every value; errors name the field.
    pub(super) fn validate(&self) -> Result<()> {
        check_range("stiffness", self.stiffness, 0.0, MAX_GAIN)?;
        check_range("damping", self.damping, 0.0, MAX_GAIN)?;
        check_range("max_torque", self.max_torque, 0.0, MAX_TORQUE)?;
        let (field, needed) = match self.control {
            Control::Torque => return Ok(()),
            Control::Velocity => ("damping", self.damping),
            Control::Position => ("stiffness", self.stiffness),
        };
        match needed > 0.0 {
            true => Ok(()),
            false => Err(Error::input(field, needed, format!("above 0 for {} control", self.control.name()))),
        }
    }
}
