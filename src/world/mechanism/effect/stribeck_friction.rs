//! Stribeck friction: friction beyond that of sliding, near rest: tau = -torque exp(-(v / velocity)^2) sign(v).
//!
//! Source: Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083.
//!
//! Differences from the source: smooth within a small velocity of rest, as Coulomb friction.

use super::coulomb_friction::smooth_sign;
use super::{
    Applicability, JointEffect, JointLaw, JointParameter, JointScale, JointState, MAX_PARAMETERS, TorqueLaw,
    parameter,
};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "stribeck_friction",
    summary: "Stribeck friction: the joint resists most near rest, and slips once it moves.",
    signature: "Slow motion sticks and slips, fast motion is as without friction.",
    equation: "tau = -torque exp(-(v / velocity)^2) sign(v)",
    parameters: &[
        JointParameter {
            starts: &[0.0, 0.1, 0.3],
            ..parameter("torque", "N m", [0.0, 1e6], 0.2, JointScale::Torque)
        },
        JointParameter {
            neutral: 0.2,
            starts: &[-0.1, 0.2],
            ..parameter("velocity", "rad/s", [0.02, 20.0], 0.2, JointScale::Absolute)
        },
    ],
    law: JointLaw::Torque(&StribeckFriction),
    applies_to: Applicability::Every,
};

struct StribeckFriction;

impl TorqueLaw for StribeckFriction {
    fn torque(&self, values: &[f64; MAX_PARAMETERS], joint: JointState) -> f64 {
        let ratio = joint.velocity / values[1].max(1e-9);
        -values[0] * libm::exp(-ratio * ratio) * smooth_sign(joint.velocity)
    }
}
