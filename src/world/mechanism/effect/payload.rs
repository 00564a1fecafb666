//! Payload: a point mass at the tip of the link.

use super::super::tree::Link;
use super::{Applicability, JointEffect, JointLaw, JointScale, parameter};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "payload",
    summary: "Payload: an additional mass at the end of the link.",
    signature: "The link is slower under torque, and gravity pulls it more.",
    equation: "m -> m + mass, at the tip",
    parameters: &[parameter("mass", "kg", [0.0, 1e6], 0.3, JointScale::Mass)],
    law: JointLaw::Links(add_mass),
    applies_to: Applicability::Every,
};

fn add_mass(values: &[f64], joint: usize, _: &[Option<usize>], links: &mut [Link]) {
    let link = &mut links[joint];
    let total = link.mass + values[0];
    let [dx, dy] = [link.tip[0] - link.centre[0], link.tip[1] - link.centre[1]];
    link.inertia += link.mass * values[0] / total * (dx * dx + dy * dy);
    link.centre = [link.centre[0] + values[0] / total * dx, link.centre[1] + values[0] / total * dy];
    link.mass = total;
}
