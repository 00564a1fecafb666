//! Length scale error: measured positions are s times the true ones, about the origin.
//!
//! Source: the pinhole camera (Hartley and Zisserman, Multiple View Geometry, section 6.1): an error of the
//! assumed distance or focal length scales all lengths alike. Valid for a camera perpendicular to the plane
//! of motion.
//!
//! Differences from the source: scaling about the scene's origin, not the image centre; the difference is a
//! common shift.

use super::{Constants, Effect, EffectKind, Measurement, Sensor, effect, scale_factor};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "position_scale",
    summary: "Length scale error: measured positions are scaled about the origin.",
    signature: "Every length has the same relative error, in flight and at rest: balls seem too close or \
        too far apart when they touch. Vertical motion alone cannot distinguish it from an error of \
        gravity; sideways motion and known sizes can.",
    equation: "measured position = s * true position; velocities likewise",
    parameters: &[scale_factor(0.05, [0.01, 100.0])],
    instrument_check: Some("measure a known length in the picture"),
    ..effect(EffectKind::Sensor(&PositionScale))
};

struct PositionScale;

impl Sensor for PositionScale {
    fn measure(&self, constants: &Constants, state: Measurement) -> Measurement {
        let s = constants[0];
        Measurement { x: s * state.x, y: s * state.y, vx: s * state.vx, vy: s * state.vy, ..state }
    }
}
