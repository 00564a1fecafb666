//! A wrong clock: it runs s times as fast as time, so that what is stamped t is what was true at t / s.
//!
//! Source: a camera whose frame rate is not what its file says, s = assumed time between frames / true time:
//! a common fault of high-speed recordings. Valid for a steady rate.
//!
//! Signature: paths are right and speeds are not: all velocities by 1/s, all accelerations by 1/s^2,
//! exponential decays by 1/s. An error of gravity changes free flights likewise, but not the speed that an
//! action sets or that rolling keeps.
//!
//! Differences from the source: none. The record ends when the end of the rollout is seen.

use super::{Act, Constants, Effect, Parameter, Search, Sensor, Shown, amplitude};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "time_scale",
    equation: "seen at t = true at t / s: the clock runs s times",
    parameters: &[Parameter {
        name: "s",
        unit: "1",
        bounds: [0.1, 10.0],
        neutral: 1.0,
        ..amplitude(0.1, 0.05, 2e-3)
    }],
    act: Act::Sensor(&TimeScale),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: Some("film a clock"),
    search: Search::Downhill,
};

struct TimeScale;

impl Sensor for TimeScale {
    fn clock(&self, constants: &Constants) -> [f64; 2] {
        [1.0 / constants[0], 0.0]
    }

    fn show(&self, constants: &Constants, state: Shown) -> Shown {
        let s = constants[0];
        Shown { vx: state.vx / s, vy: state.vy / s, omega: state.omega / s, ..state }
    }
}
