//! Link length: the link is longer or shorter than in the scene, by a factor.

use super::super::tree::Link;
use super::{Applicability, JointEffect, JointLaw, factor};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "link_length",
    summary: "Link length: the link and all that hangs on it is farther from the joint, by a factor.",
    signature: "Oscillations are slower by the root of the factor; the mass is right.",
    equation: "length -> s length, inertia -> s^2 inertia",
    parameters: &[factor([0.2, 5.0], 0.1)],
    law: JointLaw::Links(stretch),
    applies_to: Applicability::Revolute,
};

fn stretch(values: &[f64], joint: usize, parents: &[Option<usize>], links: &mut [Link]) {
    let s = values[0];
    let scaled = |v: [f64; 2]| [s * v[0], s * v[1]];
    let link = &mut links[joint];
    (link.centre, link.tip) = (scaled(link.centre), scaled(link.tip));
    link.inertia *= s * s;
    let children = links.iter_mut().zip(parents).filter(|(_, parent)| **parent == Some(joint));
    children.for_each(|(child, _)| child.offset = scaled(child.offset));
}
