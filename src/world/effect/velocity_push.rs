//! A push at a velocity: dv/dt = (ax, ay) exp(-((vx - ux) / wx)^2 / 2 - ((vy - uy) / wy)^2 / 2).
//!
//! Source: one radial basis function of velocity (see `bump`). It is how a diagnosis writes down a force that depends on how
//! a body moves, such as a drag that sets in at some speed, and that none of the named effects accounts for; no search for
//! causes tries it. Valid for velocities that the data had; three widths from (ux, uy) it is a hundredth of its height.
//!
//! Signature: bodies at the same velocity are pushed alike, wherever and whenever that is; without gravity what is at
//! (ux, uy) gathers ax a second at first, and less and less.
//!
//! Integrator: explicit Euler, v + a dt; valid while a step's a dt is short of a width.
//!
//! Differences from the source: none.

use super::bump::{bump, centre, height, near, width};
use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Search, Shape, Surroundings,
    constants,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "velocity_push",
    equation: "a = (ax, ay) exp(-((vx - ux) / wx)^2 / 2 - ((vy - uy) / wy)^2 / 2)",
    parameters: &[
        height("ax"),
        height("ay"),
        centre("ux", "m/s", Shape::Velocity),
        centre("uy", "m/s", Shape::Velocity),
        width("wx", "m/s"),
        width("wy", "m/s"),
    ],
    act: Act::Motion(&VelocityPush),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Never,
};

struct VelocityPush;

impl Motion for VelocityPush {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        let [ax, ay, ux, uy, wx, wy] = std::array::from_fn(|i| parameters[i]);
        constants(&[ax * around.time_step, ay * around.time_step, ux, uy, 1.0 / wx, 1.0 / wy])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let [ax, ay, ux, uy, per_wx, per_wy, ..] = *constants;
        let near = bump([(body.vx - ux) * per_wx, (body.vy - uy) * per_wy]);
        [body.vx + ax * near, body.vy + ay * near, body.omega]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        let ([ax, ay, ..], near) = (constants, near(constants, [&bodies.vx, &bodies.vy]));
        for lane in 0..LANES {
            bodies.vx[lane] += ax[lane] * near[lane];
            bodies.vy[lane] += ay[lane] * near[lane];
        }
    }
}
