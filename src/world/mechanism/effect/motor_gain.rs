//! Motor gain: the motor's torque is a factor of the commanded one.

use super::{Applicability, DriveLaw, JointEffect, JointLaw, JointState, MAX_PARAMETERS, factor};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "motor_gain",
    summary: "Motor gain: the motor gives more or less torque than commanded, by a factor.",
    signature: "Driven motion is too large or small in proportion to the command; free motion is right.",
    equation: "tau = s tau_motor",
    parameters: &[factor([0.05, 5.0], 0.3)],
    law: JointLaw::Drive(&MotorGain),
    applies_to: Applicability::Driven,
};

struct MotorGain;

impl DriveLaw for MotorGain {
    fn drive(&self, values: &[f64; MAX_PARAMETERS], joint: JointState) -> f64 {
        values[0] * joint.drive
    }
}
