//! Gusts: a uniform push that swings with the clock, dv/dt = (ax, ay) sin(2 pi t / period + phase).
//!
//! Source: the first harmonic of any periodic disturbance (a fan, a shaken table seen from its own frame).
//! The clock is the rollout's: t = 0 at its start. Valid where the push is uniform in space.
//!
//! Signature: bodies in the same place at the same velocity are pushed differently at different times;
//! residuals of all bodies and all trials line up over the clock and over nothing else. A period much longer
//! than the trials is wind.
//!
//! Integrator: exact, the integral of the push over the step.
//!
//! Differences from the source: one harmonic. The phase is the same in every rollout.

use std::f64::consts::PI;

use super::{Act, Constants, Effect, Motion, Moving, Parameter, Surroundings, constants};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "gust",
    acts_on: "motion",
    equation: "a = (ax, ay) sin(2 pi t / period + phase), t from the start of the rollout",
    parameters: &[
        Parameter { name: "ax", unit: "m/s^2", bounds: [-100.0, 100.0], neutral: 0.0 },
        Parameter { name: "ay", unit: "m/s^2", bounds: [-100.0, 100.0], neutral: 0.0 },
        Parameter { name: "period", unit: "s", bounds: [1e-3, 1e6], neutral: 1.0 },
        Parameter { name: "phase", unit: "rad", bounds: [-100.0, 100.0], neutral: 0.0 },
    ],
    act: Act::Motion(&Gust),
};

struct Gust;

impl Motion for Gust {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        let [ax, ay, period, phase] = [parameters[0], parameters[1], parameters[2], parameters[3]];
        // The integral of sin over a step is the sine in its middle, times the step, times sin(h) / h.
        let half = PI * around.time_step / period;
        let gained = around.time_step * libm::sin(half) / half;
        constants(&[ax * gained, ay * gained, 2.0 * PI / period, phase + half])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let [x, y, rate, phase] = [constants[0], constants[1], constants[2], constants[3]];
        let swing = libm::sin(rate * body.time + phase);
        [body.vx + x * swing, body.vy + y * swing, body.omega]
    }
}
