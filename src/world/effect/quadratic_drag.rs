//! Quadratic drag: dv/dt = -k |v| v.
//!
//! Source: Newton's law of resistance (Batchelor, An Introduction to Fluid Dynamics, section 5.11): the drag
//! on a body of cross-section A is rho C_D A v^2 / 2, so k = rho C_D A / (2 m): 0.13 / m for a table-tennis
//! ball, 0.006 for a baseball. Valid while C_D is constant: for spheres at Reynolds numbers of 1e3 to 2e5.
//!
//! Integrator: exact for the drag alone, v / (1 + k |v| dt), and so stable for any step.
//!
//! Differences from the source: spin is unaffected.

use super::{
    ConstantLanes, Constants, Effect, EffectKind, MotionLaw, MotionState, MotionStateLanes, PriorCoordinate,
    SimulationContext, amplitude, constants, effect, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "quadratic_drag",
    aliases: &["air_resistance"],
    summary: "Quadratic drag: a deceleration proportional to the square of the speed.",
    signature: "The relative loss of speed grows with the speed, so speed falls as 1/t and not \
        exponentially, and there is a terminal speed sqrt(g / k). Only trials of different speeds \
        distinguish it from linear drag, and trials in opposite directions from wind.",
    equation: "a = -k |v| v",
    parameters: &[parameter(
        "k",
        "1/m",
        [0.0, 1000.0],
        amplitude(0.03, 0.2, 2e-3).heavy_tailed(PriorCoordinate::Value),
    )],
    opposes_motion: true,
    in_richest_model: true,
    ..effect(EffectKind::Motion(&QuadraticDrag))
};

struct QuadraticDrag;

impl MotionLaw for QuadraticDrag {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        constants(&[parameters[0] * context.time_step])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let speed = (body.vx * body.vx + body.vy * body.vy).sqrt();
        let kept = 1.0 / (1.0 + constants[0] * speed);
        [body.vx * kept, body.vy * kept, body.omega]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        for (lane, k_dt) in constants[0].iter().enumerate() {
            let (vx, vy) = (bodies.vx[lane], bodies.vy[lane]);
            let kept = 1.0 / (1.0 + k_dt * (vx * vx + vy * vy).sqrt());
            bodies.vx[lane] = vx * kept;
            bodies.vy[lane] = vy * kept;
        }
    }
}
