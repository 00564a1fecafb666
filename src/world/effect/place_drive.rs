//! A localised force along or across the velocity: dv/dt = (along e + across e') exp(-((x - x0) / wx)^2 / 2 -
//! ((y - y0) / wy)^2 / 2), with e = v / |v| and e' = e rotated by +90 degrees.
//!
//! Source: one radial basis function of position (see `bump`), relative to the velocity. A diagnosis uses it
//! to write a region of any outline that accelerates, slows or deflects bodies, which none of the named
//! effects explains; the model search does not try it. Valid within the positions and speeds of the data that
//! it was fitted to. **Sign: along < 0 slows**, across > 0 deflects to the left.
//!
//! Integrator: explicit Euler, v + a dt; braking never reverses the motion.
//!
//! Differences from the source: the force does not depend on the speed, like dry friction; bodies at rest are
//! unaffected.

use super::rbf::{centre, gaussian, gaussian_of_pair, height, width};
use super::{
    ConstantLanes, Constants, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    SearchStrategy, ShapeParameter, SimulationContext, constants, effect,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "place_drive",
    summary: "A localised force along or across the velocity.",
    signature: "Residuals begin at the same position in every trial and point along or across the \
        direction of motion. A straight trajectory through the centre along x changes v^2 by 2 along \
        wx sqrt(2 pi) in both directions, unlike in any potential.",
    equation: "a = (along e + across e') exp(-((x - x0) / wx)^2 / 2 - ((y - y0) / wy)^2 / 2), e = v / |v|, e' = e turned by 90 \
               degrees",
    parameters: &[
        height("along"),
        height("across"),
        centre("x0", "m", ShapeParameter::Place),
        centre("y0", "m", ShapeParameter::Place),
        width("wx", "m"),
        width("wy", "m"),
    ],
    search: SearchStrategy::Excluded,
    ..effect(EffectKind::Motion(&PlaceDrive))
};

/// Speed below which a body has no direction, m/s.
const MIN_SPEED_M_S: f64 = 1e-9;

struct PlaceDrive;

impl MotionLaw for PlaceDrive {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let [along, across, x0, y0, wx, wy] = std::array::from_fn(|i| parameters[i]);
        constants(&[along * context.time_step, across * context.time_step, x0, y0, 1.0 / wx, 1.0 / wy])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let [along, across, x0, y0, per_wx, per_wy, ..] = *constants;
        let near = gaussian([(body.x - x0) * per_wx, (body.y - y0) * per_wy]);
        let speed = (body.vx * body.vx + body.vy * body.vy).sqrt();
        let [ex, ey] = [body.vx, body.vy].map(|v| v / speed.max(MIN_SPEED_M_S));
        let (along, across) = ((along * near).max(-speed), across * near);
        [body.vx + along * ex - across * ey, body.vy + along * ey + across * ex, body.omega]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        let ([along, across, ..], near) = (constants, gaussian_of_pair(constants, [&bodies.x, &bodies.y]));
        for lane in 0..LANES {
            let (vx, vy) = (bodies.vx[lane], bodies.vy[lane]);
            let speed = (vx * vx + vy * vy).sqrt();
            let [ex, ey] = [vx, vy].map(|v| v / speed.max(MIN_SPEED_M_S));
            let (along, across) = ((along[lane] * near[lane]).max(-speed), across[lane] * near[lane]);
            bodies.vx[lane] = vx + along * ex - across * ey;
            bodies.vy[lane] = vy + along * ey + across * ex;
        }
    }
}
