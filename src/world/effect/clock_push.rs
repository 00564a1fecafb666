//! A push at a time: dv/dt = (ax, ay) exp(-((t - t0) / w)^2 / 2), t from the start of the rollout.
//!
//! Source: one radial basis function of the clock (see `bump`). It is how a diagnosis writes down a disturbance that comes
//! at the same time in every trial, such as a gust front that no single period describes, and that none of the named effects
//! accounts for; no search for causes tries it. Valid while the data lasted; three widths from t0 it is a hundredth of its
//! height.
//!
//! Signature: all bodies of all trials are pushed alike, at the same time and wherever they are. Once it is over they have
//! gathered (ax, ay) w sqrt(2 pi).
//!
//! Integrator: v + a dt with the push in the middle of the step, whose error is of second order in dt / w.
//!
//! Differences from the source: none.

use super::bump::{bump, bumps, centre, height, width};
use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Search, Shape, Surroundings,
    constants,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "clock_push",
    equation: "a = (ax, ay) exp(-((t - t0) / w)^2 / 2), t from the start of the rollout",
    parameters: &[height("ax"), height("ay"), centre("t0", "s", Shape::Time), width("w", "s")],
    act: Act::Motion(&ClockPush),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Never,
};

struct ClockPush;

impl Motion for ClockPush {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        let ([ax, ay, t0, w], dt) = (std::array::from_fn(|i| parameters[i]), around.time_step);
        constants(&[ax * dt, ay * dt, t0 - 0.5 * dt, 1.0 / w])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let [ax, ay, t0, per_w, ..] = *constants;
        let near = bump([(body.time - t0) * per_w, 0.0]);
        [body.vx + ax * near, body.vy + ay * near, body.omega]
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        let [ax, ay, t0, per_w, ..] = constants;
        let at = std::array::from_fn(|l| (bodies.time[l] - t0[l]) * per_w[l]);
        let near = bumps(&at, &[0.0; LANES]);
        for lane in 0..LANES {
            bodies.vx[lane] += ax[lane] * near[lane];
            bodies.vy[lane] += ay[lane] * near[lane];
        }
    }
}
