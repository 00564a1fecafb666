//! Lift of a spinning body (Magnus effect): dv/dt = s v rotated by +90 degrees, that is s (-vy, vx).
//!
//! Source: Rubinow and Keller, J. Fluid Mech. 11 (1961) 447, equation 1: F = pi R^3 rho (omega x v) on a
//! slowly spinning sphere, so s = pi R^3 rho omega / m; for balls in sports s is about C_L k omega R with C_L
//! near 1. Positive for counter-clockwise spin. Valid while the spin hardly changes during a flight.
//!
//! Integrator: exact, a rotation of v by s dt.
//!
//! Differences from the source: `s` is a constant of the rollout, independent of the simulated spin.

use super::{
    ConstantLanes, Constants, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    SimulationContext, amplitude, constants, effect, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "lift",
    aliases: &["magnus"],
    summary: "Lift of a spinning body (Magnus effect): an acceleration perpendicular to the velocity.",
    signature: "The trajectory curves without any change of speed, to a circle of radius |v| / s without \
        gravity; opposite directions curve the same way, unlike in any force field. Its sign is that \
        of the spin, so it may differ between trials or settings.",
    equation: "a = s v turned by +90 degrees = s (-vy, vx)",
    parameters: &[parameter("s", "1/s", [-100.0, 100.0], amplitude(0.5, 0.7, 2e-3))],
    // A table-tennis ball whose spin differs by three revolutions per second.
    between_trial_sd: &[0.2],
    in_richest_model: true,
    reset_by_contact: true,
    ..effect(EffectKind::Motion(&Lift))
};

struct Lift;

impl MotionLaw for Lift {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let turn = parameters[0] * context.time_step;
        constants(&[libm::cos(turn), libm::sin(turn)])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let [cos, sin] = [constants[0], constants[1]];
        [body.vx * cos - body.vy * sin, body.vy * cos + body.vx * sin, body.omega]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        let [cos, sin, ..] = constants;
        for lane in 0..LANES {
            let (vx, vy) = (bodies.vx[lane], bodies.vy[lane]);
            let (cos, sin) = (cos[lane], sin[lane]);
            bodies.vx[lane] = vx * cos - vy * sin;
            bodies.vy[lane] = vy * cos + vx * sin;
        }
    }
}
