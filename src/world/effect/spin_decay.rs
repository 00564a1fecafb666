//! Spin decay in air: domega/dt = -c omega.
//!
//! Source: Lamb, Hydrodynamics (1932), section 334: the moment on a sphere that rotates in a viscous fluid is
//! 8 pi mu R^3 omega, so c = 20 pi mu R / m for a solid sphere and 12 pi mu R / m for a hollow one: 0.005 / s
//! for a table-tennis ball at rest in the air, several times that in play. Valid while omega R^2 / nu is
//! small; for faster spins c is the effective rate near the speeds that it was fitted to.
//!
//! Integrator: exact, omega exp(-c dt).
//!
//! Differences from the source: one coefficient for all bodies of any size.

use super::{
    Constants, Effect, EffectKind, MotionLaw, MotionState, SearchStrategy, SimulationContext, amplitude,
    constants, effect, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "spin_decay",
    summary: "Spin decay in air: the angular velocity decays exponentially.",
    signature: "The trajectory of a flight is unchanged and only the rotation slows; it changes how the \
        body leaves the next surface. Positions of flights do not identify it, and those after a \
        bounce distinguish it from friction only with flights of different lengths, so the model \
        search does not try it; it can be estimated, and scenes may have it.",
    equation: "domega/dt = -c omega",
    parameters: &[parameter("c", "1/s", [0.0, 100.0], amplitude(0.5, 0.7, 2e-3))],
    search: SearchStrategy::Excluded,
    ..effect(EffectKind::Motion(&SpinDecay))
};

struct SpinDecay;

impl MotionLaw for SpinDecay {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        constants(&[libm::exp(-parameters[0] * context.time_step)])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        [body.vx, body.vy, body.omega * constants[0]]
    }
}
