//! A push at a place: dv/dt = (ax, ay) exp(-((x - x0) / wx)^2 / 2 - ((y - y0) / wy)^2 / 2).
//!
//! Source: one radial basis function of place (see `bump`). It is how a diagnosis writes down a force that depends on where
//! a body is and that none of the named effects accounts for; no search for causes tries it. Valid where the data were that
//! it was fitted to; three widths from (x0, y0) it is a hundredth of its height.
//!
//! Signature: the push depends on where the body is and on nothing else, neither its velocity nor the time. Along a line
//! on which the other axis plays no part it is a potential's: crossing it at v gives v^2 + 2 ax wx sqrt(2 pi).
//!
//! Integrator: explicit Euler, v + a dt; valid for steps that are short of a width.
//!
//! Differences from the source: none.

use super::bump::{bump, centre, height, near, width};
use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Search, Shape, Surroundings,
    constants,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "place_push",
    equation: "a = (ax, ay) exp(-((x - x0) / wx)^2 / 2 - ((y - y0) / wy)^2 / 2)",
    parameters: &[
        height("ax"),
        height("ay"),
        centre("x0", "m", Shape::Place),
        centre("y0", "m", Shape::Place),
        width("wx", "m"),
        width("wy", "m"),
    ],
    act: Act::Motion(&PlacePush),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Never,
};

struct PlacePush;

impl Motion for PlacePush {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        let [ax, ay, x0, y0, wx, wy] = std::array::from_fn(|i| parameters[i]);
        constants(&[ax * around.time_step, ay * around.time_step, x0, y0, 1.0 / wx, 1.0 / wy])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let [ax, ay, x0, y0, per_wx, per_wy, ..] = *constants;
        let near = bump([(body.x - x0) * per_wx, (body.y - y0) * per_wy]);
        [body.vx + ax * near, body.vy + ay * near, body.omega]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        let ([ax, ay, ..], near) = (constants, near(constants, [&bodies.x, &bodies.y]));
        for lane in 0..LANES {
            bodies.vx[lane] += ax[lane] * near[lane];
            bodies.vy[lane] += ay[lane] * near[lane];
        }
    }
}
