//! A force localised in velocity: dv/dt = (ax, ay) exp(-((vx - ux) / wx)^2 / 2 - ((vy - uy) / wy)^2 / 2).
//!
//! Source: one radial basis function of velocity (see `bump`). A diagnosis uses it to write a
//! velocity-dependent force, such as a drag that begins at some speed, which none of the named effects
//! explains; the model search does not try it. Valid within the velocities of the data that it was fitted to;
//! three widths from (ux, uy) it is a hundredth of its maximum.
//!
//! Integrator: explicit Euler, v + a dt; valid while a dt of a step is much smaller than a width.
//!
//! Differences from the source: none.

use super::rbf::{centre, gaussian, gaussian_of_pair, height, width};
use super::{
    ConstantLanes, Constants, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    SearchStrategy, ShapeParameter, SimulationContext, constants, effect,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "velocity_push",
    summary: "A force localised in velocity.",
    signature: "Bodies at the same velocity are accelerated alike, at any position and time; without \
        gravity a body at (ux, uy) initially gains ax per second, and less and less.",
    equation: "a = (ax, ay) exp(-((vx - ux) / wx)^2 / 2 - ((vy - uy) / wy)^2 / 2)",
    parameters: &[
        height("ax"),
        height("ay"),
        centre("ux", "m/s", ShapeParameter::Velocity),
        centre("uy", "m/s", ShapeParameter::Velocity),
        width("wx", "m/s"),
        width("wy", "m/s"),
    ],
    search: SearchStrategy::Excluded,
    ..effect(EffectKind::Motion(&VelocityPush))
};

struct VelocityPush;

impl MotionLaw for VelocityPush {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let [ax, ay, ux, uy, wx, wy] = std::array::from_fn(|i| parameters[i]);
        constants(&[ax * context.time_step, ay * context.time_step, ux, uy, 1.0 / wx, 1.0 / wy])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let [ax, ay, ux, uy, per_wx, per_wy, ..] = *constants;
        let near = gaussian([(body.vx - ux) * per_wx, (body.vy - uy) * per_wy]);
        [body.vx + ax * near, body.vy + ay * near, body.omega]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        let ([ax, ay, ..], near) = (constants, gaussian_of_pair(constants, [&bodies.vx, &bodies.vy]));
        for lane in 0..LANES {
            bodies.vx[lane] += ax[lane] * near[lane];
            bodies.vy[lane] += ay[lane] * near[lane];
        }
    }
}
