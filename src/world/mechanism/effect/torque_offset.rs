//! Torque offset: a constant torque in the joint.

use super::{
    Applicability, JointEffect, JointLaw, JointScale, JointState, MAX_PARAMETERS, TorqueLaw, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "torque_offset",
    summary: "Torque offset: a constant torque, for example of a badly calibrated amplifier or of a cable.",
    signature: "The joint rests away from its equilibrium, in proportion to the cosine of its angle under gravity.",
    equation: "tau = torque",
    parameters: &[parameter("torque", "N m", [-1e6, 1e6], 0.2, JointScale::Torque)],
    law: JointLaw::Torque(&TorqueOffset),
    applies_to: Applicability::Every,
};

struct TorqueOffset;

impl TorqueLaw for TorqueOffset {
    fn torque(&self, values: &[f64; MAX_PARAMETERS], _: JointState) -> f64 {
        values[0]
    }
}
