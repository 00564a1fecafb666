//! Time scale error: the clock runs s times as fast as time, so the state stamped t is that of time t / s.
//!
//! Source: a camera whose frame rate differs from its file's, s = assumed time between frames / true time: a
//! common error of high-speed recordings. Valid for a constant rate.
//!
//! Differences from the source: none. The record ends when the end of the rollout is measured.

use super::{Constants, Effect, EffectKind, Measurement, Sensor, effect, scale_factor};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "time_scale",
    summary: "Time scale error: the clock of the measurements is too fast or too slow.",
    signature: "Trajectories are right and velocities are not: all velocities scale by 1/s, all \
        accelerations by 1/s^2, exponential decays by 1/s. An error of gravity changes free flights \
        in the same way, but not the speed that an action sets or that rolling preserves.",
    equation: "measured at t = true at t / s: the clock runs s times",
    // Accelerations change by its square: as probable as a length scale that changes them alike.
    parameters: &[scale_factor(0.025, [0.1, 10.0])],
    instrument_check: Some("film a clock"),
    ..effect(EffectKind::Sensor(&TimeScale))
};

struct TimeScale;

impl Sensor for TimeScale {
    fn clock(&self, constants: &Constants) -> [f64; 2] {
        [1.0 / constants[0], 0.0]
    }

    fn measure(&self, constants: &Constants, state: Measurement) -> Measurement {
        let s = constants[0];
        Measurement { vx: state.vx / s, vy: state.vy / s, omega: state.omega / s, ..state }
    }
}
