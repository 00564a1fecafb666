//! A localised force: dv/dt = (ax, ay) exp(-((x - x0) / wx)^2 / 2 - ((y - y0) / wy)^2 / 2).
//!
//! Source: one radial basis function of position (see `bump`). A diagnosis uses it to write a
//! position-dependent force that none of the named effects explains; the model search does not try it. Valid
//! within the positions of the data that it was fitted to; three widths from (x0, y0) it is a hundredth of
//! its maximum.
//!
//! Integrator: explicit Euler, v + a dt; valid for steps much shorter than a width.
//!
//! Differences from the source: none.

use super::rbf::{centre, gaussian, gaussian_of_pair, height, width};
use super::{
    ConstantLanes, Constants, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    SearchStrategy, ShapeParameter, SimulationContext, constants, effect,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "place_push",
    summary: "A force localised in space.",
    signature: "The force depends on the position only, not on velocity or time. Along a line on which \
        the other axis is irrelevant it is conservative: crossing it at v gives v^2 + 2 ax wx sqrt(2 \
        pi).",
    equation: "a = (ax, ay) exp(-((x - x0) / wx)^2 / 2 - ((y - y0) / wy)^2 / 2)",
    parameters: &[
        height("ax"),
        height("ay"),
        centre("x0", "m", ShapeParameter::Place),
        centre("y0", "m", ShapeParameter::Place),
        width("wx", "m"),
        width("wy", "m"),
    ],
    search: SearchStrategy::Excluded,
    ..effect(EffectKind::Motion(&PlacePush))
};

struct PlacePush;

impl MotionLaw for PlacePush {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let [ax, ay, x0, y0, wx, wy] = std::array::from_fn(|i| parameters[i]);
        constants(&[ax * context.time_step, ay * context.time_step, x0, y0, 1.0 / wx, 1.0 / wy])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let [ax, ay, x0, y0, per_wx, per_wy, ..] = *constants;
        let near = gaussian([(body.x - x0) * per_wx, (body.y - y0) * per_wy]);
        [body.vx + ax * near, body.vy + ay * near, body.omega]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        let ([ax, ay, ..], near) = (constants, gaussian_of_pair(constants, [&bodies.x, &bodies.y]));
        for lane in 0..LANES {
            bodies.vx[lane] += ax[lane] * near[lane];
            bodies.vy[lane] += ay[lane] * near[lane];
        }
    }
}
