//! Elastic joint: the transmission between motor and link twists with the motor's torque: q_measured = q + compliance tau_motor.
//!
//! Source: Spong, Journal of Dynamic Systems, Measurement, and Control 109 (1987) 310.
//!
//! Differences from the source: the inertia of the rotor is neglected, so that the spring carries the motor's torque at every time.

use super::{Applicability, JointEffect, JointLaw, JointScale, parameter};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "joint_compliance",
    summary: "Elastic joint: the transmission twists with the motor's torque, and the encoder is on the motor's side.",
    signature: "Measured positions follow steps of the command at once, before the link can move.",
    equation: "q_measured = q + compliance tau_motor",
    // Plausible: a twist of 0.02 rad at the typical torque.
    parameters: &[parameter("compliance", "rad/(N m)", [0.0, 1e3], 0.02, JointScale::PerTorque)],
    law: JointLaw::Encoder(|values, joint| joint.position + values[0] * joint.drive),
    applies_to: Applicability::Driven,
};
