//! Command delay: a command acts some time after its time stamp.

use super::{Applicability, JointEffect, JointLaw, JointParameter, JointScale, parameter};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "command_delay",
    summary: "Command delay: the motor follows its command late.",
    signature: "Driven motion is late after every change of the command; free motion is right.",
    equation: "u(t) -> u(t - delay)",
    parameters: &[JointParameter {
        starts: &[0.01, 0.04],
        ..parameter("delay", "s", [0.0, 0.5], 0.03, JointScale::Absolute)
    }],
    law: JointLaw::CommandDelay,
    applies_to: Applicability::Driven,
};
