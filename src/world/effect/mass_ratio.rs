//! Mass ratio: the scene's first body is heavier or lighter relative to the others than the scene has it.
//!
//! Source: conservation of momentum: masses act in collisions of movable bodies by their ratios only.
//!
//! Implementation: multiplies mass and moment of inertia of the first body, so that its radius of gyration is unchanged.
//!
//! Differences from the source: in a scene with more than two bodies the ratios among the others are unchanged.

use super::{
    BodyLaw, Constants, Effect, EffectKind, IdentifyingMotion, MassProperties, effect, scale_factor,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "mass_ratio",
    summary: "Mass ratio: the first body is heavier or lighter relative to the others.",
    signature: "Visible only where movable bodies collide: the lighter one is thrown farther, at any speed of \
        approach and at any restitution. Restitution changes how fast the bodies separate, not how they share the \
        momentum; flights and bounces on fixed objects are unaffected.",
    equation: "mass of the first body = s * that of the scene, and its moment of inertia likewise",
    parameters: &[scale_factor(0.3, [0.01, 100.0])],
    instrument_check: Some("weigh the bodies"),
    identified_by: Some(IdentifyingMotion::Collision),
    ..effect(EffectKind::Body(&MassRatio))
};

struct MassRatio;

impl BodyLaw for MassRatio {
    fn apply(&self, constants: &Constants, body: usize, own: MassProperties) -> MassProperties {
        let s = if body == 0 { constants[0] } else { 1.0 };
        MassProperties { mass: s * own.mass, inertia: s * own.inertia }
    }
}
