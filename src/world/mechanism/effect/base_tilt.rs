//! Base tilt: the mechanism stands at an angle, so that gravity has another direction.

use super::{Applicability, JointEffect, JointLaw, JointScale, parameter};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "base_tilt",
    summary: "Base tilt: the mechanism's base is inclined.",
    signature: "Equilibria are shifted by the same angle for every link; for one link as an encoder's offset.",
    equation: "gravity turned by -angle",
    parameters: &[parameter("angle", "rad", [-1.0, 1.0], 0.05, JointScale::Absolute)],
    law: JointLaw::Gravity(turn),
    applies_to: Applicability::Base,
};

fn turn(values: &[f64], [x, y]: [f64; 2]) -> [f64; 2] {
    let (sine, cosine) = libm::sincos(-values[0]);
    [cosine * x - sine * y, sine * x + cosine * y]
}
