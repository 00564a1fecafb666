//! A tilted camera: everything is seen turned by `angle` about the origin, counter-clockwise.
//!
//! Source: the roll of a pinhole camera (Hartley and Zisserman, Multiple View Geometry, section 6.1). A
//! camera rolled clockwise sees the world turned counter-clockwise: angle > 0. Valid for a camera that looks
//! square on.
//!
//! Signature: gravity seems to pull aslant, as wind across it would, but floors and walls, and the line
//! between things at rest, are turned as well, and bodies seem to rise or sink along a level floor.
//!
//! Differences from the source: about the scene's origin, not the picture's middle; what differs is a shift
//! of everything.

use super::{Act, Constants, Effect, Parameter, Search, Sensor, Shown, Surroundings, amplitude, constants};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "camera_tilt",
    equation: "seen = true turned by angle about the origin, counter-clockwise",
    parameters: &[Parameter {
        name: "angle",
        unit: "rad",
        bounds: [-3.2, 3.2],
        neutral: 0.0,
        ..amplitude(0.1, 0.05, 2e-3)
    }],
    act: Act::Sensor(&CameraTilt),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: Some("hang a plumb line in the picture"),
    search: Search::Downhill,
};

struct CameraTilt;

impl Sensor for CameraTilt {
    fn constants(&self, parameters: &[f64], _around: &Surroundings) -> Constants {
        constants(&[libm::cos(parameters[0]), libm::sin(parameters[0]), parameters[0]])
    }

    fn show(&self, constants: &Constants, state: Shown) -> Shown {
        let [cos, sin, angle] = [constants[0], constants[1], constants[2]];
        let turned = |x: f64, y: f64| (x * cos - y * sin, y * cos + x * sin);
        let ((x, y), (vx, vy)) = (turned(state.x, state.y), turned(state.vx, state.vy));
        Shown { x, y, vx, vy, angle: state.angle + angle, ..state }
    }
}
