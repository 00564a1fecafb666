//! Lift of a spinning body (Magnus effect): dv/dt = s v turned by +90 degrees, that is s (-vy, vx).
//!
//! Source: Rubinow and Keller, J. Fluid Mech. 11 (1961) 447, equation 1: F = pi R^3 rho (omega x v) on a
//! slowly spinning sphere, so s = pi R^3 rho omega / m; for balls in sports s is about C_L k omega R with C_L
//! near 1. Positive for counter-clockwise spin. Valid while the spin hardly changes during a flight.
//!
//! Signature: the path bends without any change of speed, to a circle of radius |v| / s without gravity;
//! opposite directions bend the same way round, which no force field does. Changes sign with the spin, so it
//! may differ between trials or settings where physics shared by all may not.
//!
//! Integrator: exact, a rotation of v by s dt.
//!
//! Differences from the source: `s` is a constant of the rollout and does not follow the simulated spin.

use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Parameter, Search,
    Surroundings, amplitude, constants,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "lift",
    equation: "a = s v turned by +90 degrees = s (-vy, vx)",
    parameters: &[Parameter {
        name: "s",
        unit: "1/s",
        bounds: [-100.0, 100.0],
        neutral: 0.0,
        ..amplitude(0.5, 0.7, 2e-3)
    }],
    act: Act::Motion(&Lift),
    holds: &[],
    opposes_motion: false,
    // A ball of table tennis whose spin differs by three turns a second.
    differs: &[0.2],
    renewed: true,
    check: None,
    search: Search::Downhill,
};

struct Lift;

impl Motion for Lift {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        let turn = parameters[0] * around.time_step;
        constants(&[libm::cos(turn), libm::sin(turn)])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let [cos, sin] = [constants[0], constants[1]];
        [body.vx * cos - body.vy * sin, body.vy * cos + body.vx * sin, body.omega]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        let [cos, sin, ..] = constants;
        for lane in 0..LANES {
            let (vx, vy) = (bodies.vx[lane], bodies.vy[lane]);
            let (cos, sin) = (cos[lane], sin[lane]);
            bodies.vx[lane] = vx * cos - vy * sin;
            bodies.vy[lane] = vy * cos + vx * sin;
        }
    }
}
