//! Shift of the centre of mass along the link.

use super::super::tree::Link;
use super::{Applicability, JointEffect, JointLaw, JointScale, parameter};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "centre_shift",
    summary: "The centre of mass is nearer to the tip or to the joint than in the scene.",
    signature: "Gravity's torque changes more than the inertia.",
    equation: "centre -> centre + shift, towards the tip",
    parameters: &[parameter("shift", "m", [-1e3, 1e3], 0.1, JointScale::Length)],
    law: JointLaw::Links(shift),
    applies_to: Applicability::Revolute,
};

fn shift(values: &[f64], joint: usize, _: &[Option<usize>], links: &mut [Link]) {
    let link = &mut links[joint];
    let length = link.tip[0].hypot(link.tip[1]);
    if length > 0.0 {
        let by = values[0] / length;
        link.centre = [link.centre[0] + by * link.tip[0], link.centre[1] + by * link.tip[1]];
    }
}
