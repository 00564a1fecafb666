//! Cogging: a torque that is periodic in the position: tau = a sin(n q) + b cos(n q), n times in a revolution.

use super::{
    Applicability, JointEffect, JointLaw, JointParameter, JointScale, JointState, MAX_PARAMETERS, TorqueLaw,
    parameter,
};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "cogging",
    summary: "Cogging: the motor's torque ripples with the position.",
    signature: "Slow motion is uneven with a period in the angle, whatever the direction.",
    equation: "tau = a sin(n q) + b cos(n q)",
    parameters: &[
        parameter("a", "N m", [-1e6, 1e6], 0.1, JointScale::Torque),
        parameter("b", "N m", [-1e6, 1e6], 0.1, JointScale::Torque),
        JointParameter {
            neutral: 6.0,
            starts: &STARTS,
            is_whole: true,
            ..parameter("n", "1/rad", [3.0, 60.0], 12.0, JointScale::Absolute)
        },
    ],
    law: JointLaw::Torque(&Cogging),
    applies_to: Applicability::Driven,
};

struct Cogging;

impl TorqueLaw for Cogging {
    fn torque(&self, values: &[f64; MAX_PARAMETERS], joint: JointState) -> f64 {
        let (sine, cosine) = libm::sincos(values[2] * joint.position);
        values[0] * sine + values[1] * cosine
    }
}

/// Every whole number of periods in a revolution, up to 60.
const STARTS: [f64; 57] = {
    let mut all = [0.0; 57];
    let mut k = 0;
    while k < all.len() {
        all[k] = k as f64 - 2.0;
        k += 1;
    }
    all
};
