//! A drive at a place: dv/dt = (along e + across e') exp(-((x - x0) / wx)^2 / 2 - ((y - y0) / wy)^2 / 2), with e = v / |v| and
//! e' = e turned by +90 degrees.
//!
//! Source: one radial basis function of place (see `bump`) that goes with the velocity. It is how a diagnosis writes down a
//! region that speeds bodies up, slows them or turns them aside, whatever its outline, and that none of the named effects
//! accounts for; no search for causes tries it. Valid where the data were that it was fitted to, and for speeds like theirs.
//! **Sign: along < 0 slows**, across > 0 turns to the left.
//!
//! Signature: residuals begin at the same place in every trial and point along or across the way, whichever way that is. A
//! straight way over the centre along x changes v^2 by 2 along wx sqrt(2 pi), there and back alike: no potential does.
//!
//! Integrator: explicit Euler, v + a dt; what slows takes no more than all of the speed.
//!
//! Differences from the source: the force does not depend on the speed, like dry friction; what lies still is left alone.

use super::bump::{bump, centre, height, near, width};
use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Search, Shape, Surroundings,
    constants,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "place_drive",
    equation: "a = (along e + across e') exp(-((x - x0) / wx)^2 / 2 - ((y - y0) / wy)^2 / 2), e = v / |v|, e' = e turned by 90 \
               degrees",
    parameters: &[
        height("along"),
        height("across"),
        centre("x0", "m", Shape::Place),
        centre("y0", "m", Shape::Place),
        width("wx", "m"),
        width("wy", "m"),
    ],
    act: Act::Motion(&PlaceDrive),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Never,
};

/// Speed below which a body has no direction, m/s.
const STILL: f64 = 1e-9;

struct PlaceDrive;

impl Motion for PlaceDrive {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        let [along, across, x0, y0, wx, wy] = std::array::from_fn(|i| parameters[i]);
        constants(&[along * around.time_step, across * around.time_step, x0, y0, 1.0 / wx, 1.0 / wy])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let [along, across, x0, y0, per_wx, per_wy, ..] = *constants;
        let near = bump([(body.x - x0) * per_wx, (body.y - y0) * per_wy]);
        let speed = (body.vx * body.vx + body.vy * body.vy).sqrt();
        let [ex, ey] = [body.vx, body.vy].map(|v| v / speed.max(STILL));
        let (along, across) = ((along * near).max(-speed), across * near);
        [body.vx + along * ex - across * ey, body.vy + along * ey + across * ex, body.omega]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        let ([along, across, ..], near) = (constants, near(constants, [&bodies.x, &bodies.y]));
        for lane in 0..LANES {
            let (vx, vy) = (bodies.vx[lane], bodies.vy[lane]);
            let speed = (vx * vx + vy * vy).sqrt();
            let [ex, ey] = [vx, vy].map(|v| v / speed.max(STILL));
            let (along, across) = ((along[lane] * near[lane]).max(-speed), across[lane] * near[lane]);
            bodies.vx[lane] = vx + along * ex - across * ey;
            bodies.vy[lane] = vy + along * ey + across * ex;
        }
    }
}
