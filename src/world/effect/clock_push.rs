//! A force pulse in time: dv/dt = (ax, ay) exp(-((t - t0) / w)^2 / 2), t from the start of the rollout.
//!
//! Source: one radial basis function of time (see `bump`). A diagnosis uses it to write a disturbance that
//! occurs at the same time in every trial, such as a gust front without a period, which none of the named
//! effects explains; the model search does not try it. Valid within the time of the data; three widths from
//! t0 it is a hundredth of its maximum.
//!
//! Integrator: v + a dt with the force in the middle of the step; the error is of second order in dt / w.
//!
//! Differences from the source: none.

use super::rbf::{centre, gaussian, gaussian_lanes, height, width};
use super::{
    ConstantLanes, Constants, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    SearchStrategy, ShapeParameter, SimulationContext, constants, effect,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "clock_push",
    summary: "A force pulse in time, common to all trials.",
    signature: "All bodies of all trials are accelerated alike, at the same time and at any position. In \
        total they gain (ax, ay) w sqrt(2 pi).",
    equation: "a = (ax, ay) exp(-((t - t0) / w)^2 / 2), t from the start of the rollout",
    parameters: &[height("ax"), height("ay"), centre("t0", "s", ShapeParameter::Time), width("w", "s")],
    search: SearchStrategy::Excluded,
    ..effect(EffectKind::Motion(&ClockPush))
};

struct ClockPush;

impl MotionLaw for ClockPush {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let ([ax, ay, t0, w], dt) = (std::array::from_fn(|i| parameters[i]), context.time_step);
        constants(&[ax * dt, ay * dt, t0 - 0.5 * dt, 1.0 / w])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let [ax, ay, t0, per_w, ..] = *constants;
        let near = gaussian([(body.time - t0) * per_w, 0.0]);
        [body.vx + ax * near, body.vy + ay * near, body.omega]
    }

    fn is_autonomous(&self) -> bool {
        false
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        let [ax, ay, t0, per_w, ..] = constants;
        let at = std::array::from_fn(|l| (bodies.time[l] - t0[l]) * per_w[l]);
        let near = gaussian_lanes(&at, &[0.0; LANES]);
        for lane in 0..LANES {
            bodies.vx[lane] += ax[lane] * near[lane];
            bodies.vy[lane] += ay[lane] * near[lane];
        }
    }
}
