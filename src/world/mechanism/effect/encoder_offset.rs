//! Encoder offset: measured positions are shifted.

use super::{Applicability, JointEffect, JointLaw, JointScale, parameter};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "encoder_offset",
    summary: "Encoder offset: the encoder's zero is not that of the scene.",
    signature: "Measured equilibria are shifted in this joint alone.",
    equation: "q_measured = q + offset",
    parameters: &[parameter("offset", "rad", [-3.2, 3.2], 0.05, JointScale::Absolute)],
    law: JointLaw::Encoder(|values, joint| joint.position + values[0]),
    applies_to: Applicability::Every,
};
