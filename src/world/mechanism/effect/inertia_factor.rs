//! Inertia: the moment of inertia about the centre of mass is another, by a factor.

use super::super::tree::Link;
use super::{Applicability, JointEffect, JointLaw, factor};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "inertia_factor",
    summary: "The moment of inertia is larger or smaller than in the scene, for example by a rotor.",
    signature: "Motion under torque and oscillations are slower; the equilibrium and gravity's torque are right.",
    equation: "I -> s I, about the centre of mass",
    parameters: &[factor([0.05, 20.0], 0.4)],
    law: JointLaw::Links(scale_inertia),
    applies_to: Applicability::Revolute,
};

fn scale_inertia(values: &[f64], joint: usize, _: &[Option<usize>], links: &mut [Link]) {
    links[joint].inertia *= values[0];
}
