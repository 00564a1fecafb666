//! A late sensor: what is stamped t is what was true at t - dt.
//!
//! Source: exposure, transfer and queueing between a camera and the clock that stamps its frames; dt < 0 is a
//! clock that was started late. Valid for a steady delay.
//!
//! Signature: everything is shifted along the clock and nothing else is: the error is the velocity times dt,
//! largest where bodies are fast, and jumps at bounces. With dt > 0 nothing moves at first: before its start
//! a body is seen waiting.
//!
//! Differences from the source: none. The record ends when the end of the rollout is seen.

use super::{Act, Constants, Effect, Parameter, Search, Sensor, amplitude};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "lag",
    equation: "seen at t = true at t - dt",
    parameters: &[Parameter {
        name: "dt",
        unit: "s",
        bounds: [-10.0, 10.0],
        neutral: 0.0,
        ..amplitude(0.1, 0.05, 1e-4)
    }],
    act: Act::Sensor(&Lag),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: Some("film a clock beside the stamps"),
    search: Search::Downhill,
};

struct Lag;

impl Sensor for Lag {
    fn clock(&self, constants: &Constants) -> [f64; 2] {
        [1.0, -constants[0]]
    }
}
