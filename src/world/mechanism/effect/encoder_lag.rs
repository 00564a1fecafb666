//! Encoder lag: measured positions are those of some time ago.

use super::{Applicability, JointEffect, JointLaw, JointParameter, JointScale, parameter};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "encoder_lag",
    summary: "Encoder lag: measured positions are late.",
    signature: "All motion is late, the response to commands as well: as a delay of commands, except for feedback and free motion.",
    equation: "q_measured(t) = q(t - age)",
    parameters: &[JointParameter {
        starts: &[0.01],
        ..parameter("age", "s", [0.0, 0.5], 0.02, JointScale::Absolute)
    }],
    law: JointLaw::EncoderLag,
    applies_to: Applicability::Every,
};
