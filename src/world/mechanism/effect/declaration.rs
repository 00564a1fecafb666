//! Declarations of effects in joints: laws, parameters and metadata.

use super::super::tree::Link;
use crate::task::joint::JointKind;
use crate::world::effect::LANES;

/// Maximum number of parameters of an effect.
pub const MAX_PARAMETERS: usize = 3;

/// An effect in a joint.
pub struct JointEffect {
    /// Name in scenes and reports.
    pub name: &'static str,
    /// Description in one sentence.
    pub summary: &'static str,
    /// How it shows in recordings, and how it differs from similar effects.
    pub signature: &'static str,
    pub equation: &'static str,
    pub parameters: &'static [JointParameter],
    pub law: JointLaw,
    /// Joints that can have it.
    pub applies_to: Applicability,
}

/// Joints that can have an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Applicability {
    Every,
    Revolute,
    /// With a motor.
    Driven,
    /// On the world, of a scene with gravity.
    Base,
}

/// A parameter of an effect.
pub struct JointParameter {
    pub name: &'static str,
    /// SI unit for a revolute joint.
    pub unit: &'static str,
    /// Allowed values, inclusive.
    pub bounds: [f64; 2],
    /// Value at which the effect vanishes.
    pub neutral: f64,
    /// Prior standard deviation about the neutral value, in units of `scale`.
    pub plausible: f64,
    pub scale: JointScale,
    /// Starting values for the search, in units of `scale` from the neutral value.
    pub starts: &'static [f64],
    /// Whether it is a whole number: the search tries its starting values alone.
    pub is_whole: bool,
}

/// The unit of a parameter's plausible size, from the mechanism and the recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointScale {
    /// One.
    Absolute,
    /// Typical torque in the joint.
    Torque,
    /// Typical torque over typical velocity.
    TorquePerVelocity,
    /// One over the typical torque.
    PerTorque,
    /// Typical velocity.
    Velocity,
    /// Mass of the link.
    Mass,
    /// Length of the link.
    Length,
}

/// Changes links by values: index of the joint, parents of all links, links.
pub type LinkChange = fn(&[f64], usize, &[Option<usize>], &mut [Link]);

/// The law of an effect, by kind; values are those of its parameters.
#[derive(Clone, Copy)]
pub enum JointLaw {
    /// Torque on the joint.
    Torque(&'static dyn TorqueLaw),
    /// Change of the motor's torque.
    Drive(&'static dyn DriveLaw),
    /// Change of the links.
    Links(LinkChange),
    /// Change of gravity.
    Gravity(fn(&[f64], [f64; 2]) -> [f64; 2]),
    /// Delay of commands by the first value, s.
    CommandDelay,
    /// Measured position at a joint's actual state.
    Encoder(fn(&[f64], JointState) -> f64),
    /// Measured positions are whole multiples of the first value, after noise.
    Resolution,
    /// Age of measured positions: the first value, s.
    EncoderLag,
}

/// The state of a joint as available to laws.
#[derive(Clone, Copy, Debug)]
pub struct JointState {
    /// rad
    pub position: f64,
    /// rad/s
    pub velocity: f64,
    /// Torque of the motor, N m, and its stated limit.
    pub drive: f64,
    pub max_torque: f64,
}

/// A law of torque.
pub trait TorqueLaw: Sync {
    /// Torque on the joint, N m.
    fn torque(&self, values: &[f64; MAX_PARAMETERS], joint: JointState) -> f64;

    /// Adds the torque in every lane.
    fn add_lanes(&self, values: &LawValues, joints: &JointLanes, total: &mut [f64; LANES]) {
        for (lane, total) in total.iter_mut().enumerate() {
            *total += self.torque(&values[lane], joints.in_lane(lane));
        }
    }
}

/// A law of the motor.
pub trait DriveLaw: Sync {
    /// The motor's torque, N m.
    fn drive(&self, values: &[f64; MAX_PARAMETERS], joint: JointState) -> f64;

    /// Replaces the motor's torque in every lane.
    fn change_lanes(&self, values: &LawValues, joints: &mut JointLanes) {
        for (lane, values) in values.iter().enumerate() {
            joints.drive[lane] = self.drive(values, joints.in_lane(lane));
        }
    }
}

/// Values of a law's parameters in every lane.
pub type LawValues = [[f64; MAX_PARAMETERS]; LANES];

/// [`JointState`] in every lane; the stated limit is the same in all.
#[derive(Clone, Copy, Debug, Default)]
pub struct JointLanes {
    pub position: [f64; LANES],
    pub velocity: [f64; LANES],
    pub drive: [f64; LANES],
    pub max_torque: f64,
}

impl JointLanes {
    /// The state in a lane.
    #[inline]
    pub(super) fn in_lane(&self, lane: usize) -> JointState {
        JointState {
            position: self.position[lane],
            velocity: self.velocity[lane],
            drive: self.drive[lane],
            max_torque: self.max_torque,
        }
    }
}

/// An effect in a joint, with values.
#[derive(Clone)]
pub struct JointTerm {
    pub effect: &'static JointEffect,
    /// Index of the joint.
    pub joint: usize,
    pub values: Vec<f64>,
}

impl JointEffect {
    /// Whether a joint can have it.
    pub fn fits(&self, kind: JointKind, is_driven: bool, on_world: bool, has_gravity: bool) -> bool {
        match self.applies_to {
            Applicability::Every => true,
            Applicability::Revolute => kind == JointKind::Revolute,
            Applicability::Driven => is_driven,
            Applicability::Base => on_world && has_gravity,
        }
    }

    /// Whether it is the resolution of an encoder, which positions show whatever the motion.
    pub fn is_resolution(&self) -> bool {
        matches!(self.law, JointLaw::Resolution)
    }

    /// The term with neutral values.
    pub fn neutral(&'static self, joint: usize) -> JointTerm {
        JointTerm { effect: self, joint, values: self.parameters.iter().map(|p| p.neutral).collect() }
    }
}

/// A parameter that is neutral at 0 and searched from there.
pub(super) const fn parameter(
    name: &'static str,
    unit: &'static str,
    bounds: [f64; 2],
    plausible: f64,
    scale: JointScale,
) -> JointParameter {
    JointParameter { name, unit, bounds, neutral: 0.0, plausible, scale, starts: &[0.0], is_whole: false }
}

/// A factor that is neutral at 1.
pub(super) const fn factor(bounds: [f64; 2], plausible: f64) -> JointParameter {
    JointParameter { neutral: 1.0, ..parameter("s", "1", bounds, plausible, JointScale::Absolute) }
}
