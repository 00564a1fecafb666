//! Viscous friction: tau = -b v.

use super::{
    Applicability, JointEffect, JointLaw, JointScale, JointState, MAX_PARAMETERS, TorqueLaw, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "viscous_friction",
    summary: "Viscous friction: a torque against the velocity, in proportion to it.",
    signature: "Free oscillations decay exponentially, at every amplitude at the same rate.",
    equation: "tau = -b v",
    parameters: &[parameter("b", "N m s/rad", [0.0, 1e6], 0.3, JointScale::TorquePerVelocity)],
    law: JointLaw::Torque(&ViscousFriction),
    applies_to: Applicability::Every,
};

struct ViscousFriction;

impl TorqueLaw for ViscousFriction {
    fn torque(&self, values: &[f64; MAX_PARAMETERS], joint: JointState) -> f64 {
        -values[0] * joint.velocity
    }
}
