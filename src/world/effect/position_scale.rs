//! A wrong length scale: positions are seen as s times the true ones, about the origin.
//!
//! Source: the pinhole camera (Hartley and Zisserman, Multiple View Geometry, section 6.1): an error of the
//! assumed distance or focal length scales all lengths alike. Valid for a camera that looks square on and for
//! motion in its plane.
//!
//! Signature: every length is off by the same share, in flight as at rest: balls seem too near or too far
//! from each other when they touch. Gravity alone cannot tell it from an error of gravity; sideways motion
//! and known sizes can.
//!
//! Differences from the source: about the scene's origin, not the picture's middle; what differs is a shift
//! of everything.

use super::{Act, Constants, Effect, Parameter, Search, Sensor, Shown, amplitude};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "position_scale",
    equation: "seen position = s * true position; velocities likewise",
    parameters: &[Parameter {
        name: "s",
        unit: "1",
        bounds: [0.1, 10.0],
        neutral: 1.0,
        ..amplitude(0.1, 0.05, 2e-3)
    }],
    act: Act::Sensor(&PositionScale),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: Some("measure a known length in the picture"),
    search: Search::Downhill,
};

struct PositionScale;

impl Sensor for PositionScale {
    fn show(&self, constants: &Constants, state: Shown) -> Shown {
        let s = constants[0];
        Shown { x: s * state.x, y: s * state.y, vx: s * state.vx, vy: s * state.vy, ..state }
    }
}
