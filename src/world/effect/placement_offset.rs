//! Placement offset: objects placed by an action are shifted by (dx, dy).
//!
//! Source: the calibration error of a robot's hand relative to the world's frame (hand-eye calibration),
//! constant over trials. Valid for small offsets: an action is validated at its intended position, so the
//! object may end up in a wall.
//!
//! Differences from the source: no rotation. It shifts the bodies and statics whose x or y the scene's action
//! sets; if the actions set no position, all movable bodies.

use super::{Constants, Effect, EffectKind, PlacementLaw, amplitude, effect, parameter};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "placement_offset",
    summary: "Placement offset: bodies placed by an action are shifted.",
    signature: "Only placed objects start at an offset, always the same vector, and are measured at \
        their actual position from the first observation on; unlike with a sensor offset, other \
        objects are measured where they should be.",
    equation: "placed position = intended position + (dx, dy)",
    parameters: &[
        parameter("dx", "m", [-10.0, 10.0], amplitude(0.1, 0.1, 2e-3)),
        parameter("dy", "m", [-10.0, 10.0], amplitude(0.1, 0.1, 2e-3)),
    ],
    ..effect(EffectKind::Action(&PlacementOffset))
};

struct PlacementOffset;

impl PlacementLaw for PlacementOffset {
    fn place(&self, constants: &Constants, asked: [f64; 2]) -> [f64; 2] {
        [asked[0] + constants[0], asked[1] + constants[1]]
    }
}
