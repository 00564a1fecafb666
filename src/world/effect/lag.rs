//! Sensor delay: the state stamped t is that of time t - dt.
//!
//! Source: exposure, transfer and queueing between a camera and the clock that stamps its frames; dt < 0 is a
//! clock that was started late. Valid for a constant delay.
//!
//! Differences from the source: none. The record ends when the end of the rollout is measured.

use super::{Constants, Effect, EffectKind, Sensor, amplitude, effect, parameter};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "lag",
    summary: "Sensor delay: measurements are stamped too late or too early.",
    signature: "A shift in time of everything: the error is the velocity times dt, largest for fast \
        bodies, and jumps at bounces. With dt > 0 bodies at first appear at rest at their initial \
        position.",
    equation: "seen at t = true at t - dt",
    parameters: &[parameter("dt", "s", [-10.0, 10.0], amplitude(0.1, 0.05, 1e-4))],
    instrument_check: Some("film a clock next to the time stamps"),
    ..effect(EffectKind::Sensor(&SensorDelay))
};

struct SensorDelay;

impl Sensor for SensorDelay {
    fn clock(&self, constants: &Constants) -> [f64; 2] {
        [1.0, -constants[0]]
    }
}
