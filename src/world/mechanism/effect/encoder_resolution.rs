//! Encoder resolution: measured positions are whole multiples of a step.

use super::{Applicability, JointEffect, JointLaw, JointScale, parameter};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "encoder_resolution",
    summary: "Encoder resolution: measured positions are whole multiples of a step.",
    signature: "Measured positions lie on a grid, whose step is larger than the noise.",
    equation: "q_measured = step round(q / step)",
    parameters: &[parameter("step", "rad", [0.0, 3.2], 0.005, JointScale::Absolute)],
    law: JointLaw::Resolution,
    applies_to: Applicability::Every,
};
