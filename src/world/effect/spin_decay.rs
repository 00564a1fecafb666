//! Spin that the air takes: domega/dt = -c omega.
//!
//! Source: Lamb, Hydrodynamics (1932), section 334: the couple on a sphere that turns in a viscous fluid is
//! 8 pi mu R^3 omega, so c = 20 pi mu R / m for a solid sphere and 12 pi mu R / m for a hollow one: 0.005 / s for a
//! table-tennis ball at rest in the air, several times that in play. Valid while omega R^2 / nu is small; for faster
//! spins c stands for what is lost about the speeds it was fitted to.
//!
//! Signature: a flight keeps its path to the bit and only turns ever slower; what it changes is how the body comes off
//! the next surface. Positions of flights do not tell it, and those after a bounce tell it from friction or grip by
//! flights of unlike lengths alone, so no search for causes tries it; it can be fitted along, and scenes may have it.
//!
//! Integrator: exact, omega exp(-c dt).
//!
//! Differences from the source: one coefficient for all bodies, whatever their size.

use super::{Act, Constants, Effect, Motion, Moving, Parameter, Search, Surroundings, amplitude, constants};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "spin_decay",
    equation: "domega/dt = -c omega",
    parameters: &[Parameter {
        name: "c",
        unit: "1/s",
        bounds: [0.0, 100.0],
        neutral: 0.0,
        ..amplitude(0.5, 0.7, 2e-3)
    }],
    act: Act::Motion(&SpinDecay),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Never,
};

struct SpinDecay;

impl Motion for SpinDecay {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        constants(&[libm::exp(-parameters[0] * around.time_step)])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        [body.vx, body.vy, body.omega * constants[0]]
    }

    fn timeless(&self) -> bool {
        true
    }
}
