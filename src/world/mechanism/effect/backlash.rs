//! Backlash: the motor turns freely through a gap when its torque changes sign: q_measured = q + gap/2 sign(tau_motor).
//!
//! Source: Nordin and Gutman, Automatica 38 (2002) 1633.
//!
//! Differences from the source: the inertia of the rotor is neglected, so that it is always at one side of the gap; smooth within
//! [`SMOOTH_TORQUE`] of no torque.

use super::{Applicability, JointEffect, JointLaw, JointScale, parameter};

/// Torque below which the rotor begins to leave its side of the gap, N m.
const SMOOTH_TORQUE: f64 = 0.005;

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "backlash",
    summary: "Backlash: a gap in the gears, and the encoder on the motor's side.",
    signature: "Measured positions jump by the same angle whenever the motor's torque changes sign, whatever its size.",
    equation: "q_measured = q + gap / 2 sign(tau_motor)",
    parameters: &[parameter("gap", "rad", [0.0, 3.2], 0.02, JointScale::Absolute)],
    law: JointLaw::Encoder(|values, joint| {
        let ratio = joint.drive / SMOOTH_TORQUE;
        joint.position + 0.5 * values[0] * ratio / (1.0 + ratio * ratio).sqrt()
    }),
    applies_to: Applicability::Driven,
};
