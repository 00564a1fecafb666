//! Encoder scale: measured positions are a factor of the actual ones.

use super::{Applicability, JointEffect, JointLaw, factor};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "encoder_scale",
    summary: "Encoder scale: measured positions are too large or small by a factor.",
    signature: "Amplitudes are wrong and periods right.",
    equation: "q_measured = s q",
    parameters: &[factor([0.2, 5.0], 0.05)],
    law: JointLaw::Encoder(|values, joint| values[0] * joint.position),
    applies_to: Applicability::Every,
};
