//! Inertia error: the moments of inertia of all bodies are s times those of the scene.
//!
//! Source: elementary: relative to a uniform disc (m R^2 / 2) a solid sphere has s = 0.8, a hollow sphere 1.33, a
//! hoop 2. Valid for bodies of one kind.
//!
//! Differences from the source: none.

use super::{
    BodyLaw, Constants, Effect, EffectKind, IdentifyingMotion, MassProperties, effect, scale_factor,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "inertia_error",
    summary: "Inertia error: bodies are harder or easier to turn than the scene has it.",
    signature: "On a slope rolling bodies accelerate by g sin(angle) / (1 + I / (m R^2)), the same at any speed, while \
        flights and sliding bodies are unchanged. Gravity that is too strong changes flights too, and a level floor \
        shows neither. A recording on one slope alone cannot tell them apart.",
    equation: "moment of inertia = s * that of the scene",
    parameters: &[scale_factor(0.3, [0.01, 100.0])],
    instrument_check: Some(
        "give `inertia` in the scene: \"solid_sphere\", \"hollow_sphere\", \"hoop\" or kg m^2",
    ),
    identified_by: Some(IdentifyingMotion::Rolling),
    ..effect(EffectKind::Body(&InertiaError))
};

struct InertiaError;

impl BodyLaw for InertiaError {
    fn apply(&self, constants: &Constants, _body: usize, own: MassProperties) -> MassProperties {
        MassProperties { inertia: constants[0] * own.inertia, ..own }
    }
}
