//! Wind: a uniform acceleration, dv/dt = (ax, ay).
//!
//! Source: the limit of moving air that is much faster than the body, where drag no longer depends on the
//! body's own velocity; also the force on a charged body between plates. Valid for bodies that are slow
//! relative to the air.
//!
//! Integrator: exact, v + a dt.
//!
//! Differences from the source: independent of shape and mass.

use super::{
    ConstantLanes, Constants, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    SimulationContext, amplitude, constants, effect, gravity_error, parameter, position_scale, time_scale,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "wind",
    summary: "Wind: a uniform acceleration.",
    signature: "Free flight remains a parabola, tilted: the same acceleration for every trial, position \
        and speed. Along gravity it cannot be distinguished from an error of gravity; across it, a \
        tilted camera also rotates objects at rest (floors, and the line between two balls), which \
        wind leaves unchanged.",
    equation: "a = (ax, ay)",
    parameters: &[
        parameter("ax", "m/s^2", [-100.0, 100.0], amplitude(1.0, 1.0, 1e-2)),
        parameter("ay", "m/s^2", [-100.0, 100.0], amplitude(1.0, 1.0, 1e-2)),
    ],
    special_cases: &[&gravity_error::EFFECT, &position_scale::EFFECT, &time_scale::EFFECT],
    between_trial_sd: &[0.1, 0.1],
    in_richest_model: true,
    ..effect(EffectKind::Motion(&Wind))
};

struct Wind;

impl MotionLaw for Wind {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        constants(&[parameters[0] * context.time_step, parameters[1] * context.time_step])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        [body.vx + constants[0], body.vy + constants[1], body.omega]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        let [x, y, ..] = constants;
        for lane in 0..LANES {
            bodies.vx[lane] += x[lane];
            bodies.vy[lane] += y[lane];
        }
    }
}
