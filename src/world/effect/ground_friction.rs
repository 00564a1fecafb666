//! Ground friction: a constant deceleration mu g against the motion, of bodies that slide on the plane of the scene, seen from above.
//!
//! Source: Coulomb's law of sliding friction; g is standard gravity, which pulls perpendicularly to the plane. mu is 0.005 to 0.02 for a
//! puck on air or ice, 0.1 to 0.6 for solids on tables.
//!
//! Integrator: exact in a step: the speed decreases by mu g dt, at most to zero.
//!
//! Differences from the source: it acts at the centre, so that spin is not slowed and a spinning body slides no farther. Static
//! friction equals kinetic friction, and does not hold a body against forces within the plane.

use super::{
    Constants, Effect, EffectKind, IdentifyingMotion, MotionLaw, MotionState, SimulationContext, amplitude,
    constants, effect, parameter,
};
use crate::task::constants::STANDARD_GRAVITY_M_S2;

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "ground_friction",
    summary: "Ground friction: bodies seen from above slide to a stop on the plane.",
    signature: "The speed decreases at a constant rate, the same at any speed, and the body stops within v^2 / (2 mu g). \
        Drag decreases with the speed and never stops a body. Only in scenes without gravity in their plane.",
    equation: "a = -mu g v/|v|, g = 9.81 m/s^2",
    parameters: &[parameter("mu", "1", [0.0, 10.0], amplitude(0.1, 0.1, 1e-3))],
    opposes_motion: true,
    is_abrupt: true,
    in_richest_model: true,
    identified_by: Some(IdentifyingMotion::SeenFromAbove),
    ..effect(EffectKind::Motion(&GroundFriction))
};

struct GroundFriction;

impl MotionLaw for GroundFriction {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        constants(&[parameters[0] * STANDARD_GRAVITY_M_S2 * context.time_step])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let speed = (body.vx * body.vx + body.vy * body.vy).sqrt();
        let lost = constants[0];
        let kept = if lost < speed { 1.0 - lost / speed } else { f64::from(lost == 0.0) };
        [body.vx * kept, body.vy * kept, body.omega]
    }
}
