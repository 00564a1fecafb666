//! Camera tilt: the image is rotated by `angle` about the origin, counter-clockwise.
//!
//! Source: the roll of a pinhole camera (Hartley and Zisserman, Multiple View Geometry, section 6.1). A
//! camera rolled clockwise sees the world rotated counter-clockwise: angle > 0. Valid for a camera
//! perpendicular to the plane of motion.
//!
//! Differences from the source: the rotation is about the scene's origin, not the image centre; the
//! difference is a common shift.

use super::{
    Constants, Effect, EffectKind, Measurement, Sensor, SimulationContext, amplitude, constants, effect,
    parameter,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "camera_tilt",
    summary: "Camera tilt: the image is rotated about the origin.",
    signature: "Gravity seems tilted, like a wind across it, but floors, walls and the line between \
        objects at rest are rotated as well, and bodies seem to rise or sink along a level floor.",
    equation: "seen = true turned by angle about the origin, counter-clockwise",
    parameters: &[parameter("angle", "rad", [-3.2, 3.2], amplitude(0.1, 0.05, 2e-3))],
    instrument_check: Some("hang a plumb line in the picture"),
    ..effect(EffectKind::Sensor(&CameraTilt))
};

struct CameraTilt;

impl Sensor for CameraTilt {
    fn constants(&self, parameters: &[f64], _context: &SimulationContext) -> Constants {
        constants(&[libm::cos(parameters[0]), libm::sin(parameters[0]), parameters[0]])
    }

    fn measure(&self, constants: &Constants, state: Measurement) -> Measurement {
        let [cos, sin, angle] = [constants[0], constants[1], constants[2]];
        let turned = |x: f64, y: f64| (x * cos - y * sin, y * cos + x * sin);
        let ((x, y), (vx, vy)) = (turned(state.x, state.y), turned(state.vx, state.vy));
        Measurement { x, y, vx, vy, angle: state.angle + angle, ..state }
    }
}
