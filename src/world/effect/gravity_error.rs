//! Gravity error: dv/dt = dg along gravity.
//!
//! Source: elementary: local g differs by 0.5 % over the Earth, and a tilted table or an immersed body
//! (buoyancy: dg = -g rho_fluid / rho_body) changes it by any amount. Valid for a uniform error.
//!
//! Integrator: exact, v + dg dt.
//!
//! Differences from the source: none. Without gravity there is no direction, and no effect.

use super::{
    ConstantLanes, Constants, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    PriorCoordinate, SimulationContext, amplitude, constants, effect, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "gravity_error",
    summary: "Gravity error: gravity is stronger or weaker than in the scene.",
    signature: "Free flight remains a parabola along gravity with another curvature; fall times scale as \
        sqrt(g / (g + dg)) at any height, and the weight on the floor changes as well (friction \
        stops sliding objects sooner). An error of the length scale also changes the curvature, but \
        sideways motion as well.",
    equation: "a = dg g/|g|, g being the scene's gravity: dg > 0 pulls harder",
    parameters: &[parameter(
        "dg",
        "m/s^2",
        [-100.0, 100.0],
        amplitude(1.0, 0.5, 1e-2).heavy_tailed(PriorCoordinate::LogGravity),
    )],
    ..effect(EffectKind::Motion(&GravityError))
};

struct GravityError;

impl MotionLaw for GravityError {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let [gx, gy] = context.gravity;
        let g = (gx * gx + gy * gy).sqrt();
        if g > 0.0 {
            let gained = parameters[0] * context.time_step;
            constants(&[gained * (gx / g), gained * (gy / g)])
        } else {
            constants(&[])
        }
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
