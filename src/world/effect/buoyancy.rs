//! Buoyancy: dv/dt = -ratio g, the weight of the displaced fluid.
//!
//! Source: Archimedes' principle: ratio is the density of the fluid over that of the body, 1.2 / 86 = 0.014 for a table-tennis ball in
//! air, 0.13 for steel in water. Valid in a fluid at rest.
//!
//! Integrator: exact, v - ratio g dt.
//!
//! Differences from the source: without the added mass of the accelerated fluid, (1 + ratio / 2) times the body's own for a sphere.

use super::{
    Constants, Effect, EffectKind, MotionLaw, MotionState, SearchStrategy, SimulationContext, amplitude,
    constants, effect, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "buoyancy",
    summary: "Buoyancy: a fluid carries part of the weight.",
    signature: "Trajectories are those of a weaker gravity: the diagnosis tries `gravity_error`, whose dg is then -ratio g, and \
        cannot tell the two apart. In liquids it comes with drag; a body lighter than the fluid rises.",
    equation: "a = -ratio g, ratio = density of the fluid / density of the body",
    parameters: &[parameter("ratio", "1", [0.0, 1000.0], amplitude(0.1, 0.5, 1e-3))],
    instrument_check: Some("weigh the body in the fluid"),
    search: SearchStrategy::Excluded,
    ..effect(EffectKind::Motion(&Buoyancy))
};

struct Buoyancy;

impl MotionLaw for Buoyancy {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let [gx, gy] = context.gravity;
        let carried = parameters[0] * context.time_step;
        constants(&[-carried * gx, -carried * gy])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        [body.vx + constants[0], body.vy + constants[1], body.omega]
    }
}
