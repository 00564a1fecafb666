//! Coulomb friction: tau = -torque sign(v), smooth within [`SMOOTH_VELOCITY`] of rest.

use super::{
    Applicability, JointEffect, JointLaw, JointScale, JointState, MAX_PARAMETERS, TorqueLaw, parameter,
};

/// Velocity below which friction falls off, rad/s: a joint at rest creeps instead of sticking.
pub const SMOOTH_VELOCITY: f64 = 0.02;

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "coulomb_friction",
    summary: "Coulomb friction: a constant torque against the velocity.",
    signature: "Free oscillations lose the same amplitude in every period and stop; small commands do not move the joint.",
    equation: "tau = -torque sign(v)",
    parameters: &[parameter("torque", "N m", [0.0, 1e6], 0.2, JointScale::Torque)],
    law: JointLaw::Torque(&CoulombFriction),
    applies_to: Applicability::Every,
};

struct CoulombFriction;

impl TorqueLaw for CoulombFriction {
    fn torque(&self, values: &[f64; MAX_PARAMETERS], joint: JointState) -> f64 {
        -values[0] * smooth_sign(joint.velocity)
    }
}

/// The sign of a velocity, smooth at 0.
pub fn smooth_sign(velocity: f64) -> f64 {
    let ratio = velocity / SMOOTH_VELOCITY;
    ratio / (1.0 + ratio * ratio).sqrt()
}
