//! A placement that is off: what an action places ends up shifted by (dx, dy).
//!
//! Source: the calibration error of a robot's hand against the world's frame (hand-eye calibration), steady
//! over trials. Valid for small offsets: an action is judged as it was asked for, so one may end up in a
//! wall.
//!
//! Signature: only what the action places starts off, always by the same vector, and is *seen* where it
//! really is from the first observation on; unlike a sensor's shift, what stands in the scene is seen where
//! it should be.
//!
//! Differences from the source: no rotation. Shifted are the bodies and statics whose x or y the scene's
//! action sets; in a scene whose actions set no place, every movable body.

use super::{Act, Constants, Effect, Parameter, Placing, Search, amplitude};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "placement_offset",
    equation: "placed position = asked position + (dx, dy)",
    parameters: &[
        Parameter { name: "dx", unit: "m", bounds: [-10.0, 10.0], neutral: 0.0, ..amplitude(0.1, 0.1, 2e-3) },
        Parameter { name: "dy", unit: "m", bounds: [-10.0, 10.0], neutral: 0.0, ..amplitude(0.1, 0.1, 2e-3) },
    ],
    act: Act::Action(&PlacementOffset),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Downhill,
};

struct PlacementOffset;

impl Placing for PlacementOffset {
    fn placed(&self, constants: &Constants, asked: [f64; 2]) -> [f64; 2] {
        [asked[0] + constants[0], asked[1] + constants[1]]
    }
}
