//! Moving air: quadratic drag relative to air that moves at (ux, uy), dv/dt = -k |v - u| (v - u).
//!
//! Source: as `quadratic_drag` (Batchelor, section 5.11), in the frame of the air.
//!
//! Integrator: exact for the drag alone, (v - u) / (1 + k |v - u| dt) + u, and so stable for any step.
//!
//! Differences from the source: spin is unaffected; with k = 0 there is no effect at any velocity of the air.

use super::{
    ConstantLanes, Constants, DataRange, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    ParameterDeclaration, SearchStrategy, ShapeParameter, SimulationContext, amplitude, constants, effect,
    parameter, quadratic_drag, shape, wind,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "moving_air",
    summary: "Moving air: quadratic drag relative to air that moves.",
    signature: "A body at rest is carried along and ends at the velocity of the air (with gravity: at \
        sqrt(g / k) relative to it). Unlike wind the force decreases as the body gains speed; unlike \
        drag in still air it moves bodies at rest and depends on the direction.",
    equation: "a = -k |v - u| (v - u), u = (ux, uy)",
    parameters: &[
        parameter(
            "ux",
            "m/s",
            [-100.0, 100.0],
            ParameterDeclaration { prior_sd: 3.0, ..shape(ShapeParameter::Velocity, 1.0, 1e-2) },
        ),
        parameter(
            "uy",
            "m/s",
            [-100.0, 100.0],
            ParameterDeclaration { prior_sd: 3.0, ..shape(ShapeParameter::Velocity, 1.0, 1e-2) },
        ),
        parameter("k", "1/m", [0.0, 1000.0], amplitude(0.03, 0.2, 2e-3)),
    ],
    special_cases: &[&quadratic_drag::EFFECT, &wind::EFFECT],
    opposes_motion: true,
    search: SearchStrategy::FromStarts(starts),
    ..effect(EffectKind::Motion(&MovingAir))
};

/// Air that moves in either direction at half the typical speed, with a drag that removes a fiftieth of it.
fn starts(span: &DataRange) -> Vec<Vec<f64>> {
    let (u, k) = (0.5 * span.speed, 0.02 / (span.speed * span.duration).max(1e-9));
    vec![vec![u, 0.0, k], vec![-u, 0.0, k], vec![0.0, u, k], vec![0.0, -u, k]]
}

struct MovingAir;

impl MotionLaw for MovingAir {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        constants(&[parameters[0], parameters[1], parameters[2] * context.time_step])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let (wx, wy) = (body.vx - constants[0], body.vy - constants[1]);
        let push = constants[2] * (wx * wx + wy * wy).sqrt();
        let lost = push / (1.0 + push);
        [body.vx - lost * wx, body.vy - lost * wy, body.omega]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        let [ux, uy, k_dt, ..] = constants;
        for lane in 0..LANES {
            let (vx, vy) = (bodies.vx[lane], bodies.vy[lane]);
            let (wx, wy) = (vx - ux[lane], vy - uy[lane]);
            let push = k_dt[lane] * (wx * wx + wy * wy).sqrt();
            let lost = push / (1.0 + push);
            bodies.vx[lane] = vx - lost * wx;
            bodies.vy[lane] = vy - lost * wy;
        }
    }
}
