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

use super::{
    Act, Constants, Effect, Motion, Moving, Parameter, Search, Shape, Span, Surroundings, amplitude,
    constants, shape, wind,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "gust",
    equation: "a = (ax, ay) sin(2 pi t / period + phase), t from the start of the rollout",
    parameters: &[
        Parameter {
            name: "ax",
            unit: "m/s^2",
            bounds: [-100.0, 100.0],
            neutral: 0.0,
            ..amplitude(1.0, 2.0, 1e-2)
        },
        Parameter {
            name: "ay",
            unit: "m/s^2",
            bounds: [-100.0, 100.0],
            neutral: 0.0,
            ..amplitude(1.0, 2.0, 1e-2)
        },
        Parameter {
            name: "period",
            unit: "s",
            bounds: [1e-3, 1e6],
            neutral: 1.0,
            ..shape(Shape::Period, 1.0, 1e-4)
        },
        Parameter {
            name: "phase",
            unit: "rad",
            bounds: [-100.0, 100.0],
            neutral: 0.0,
            ..shape(Shape::Phase, 1.0, 2e-3)
        },
    ],
    act: Act::Motion(&Gust),
    holds: &[&wind::EFFECT],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::From(starts),
};

/// Periods from a few observations to more than a trial, a quarter of each apart.
fn starts(span: &Span) -> Vec<Vec<f64>> {
    let mut out = Vec::new();
    for share in [0.25, 0.4, 0.65, 1.0, 1.6, 2.5] {
        let period = (share * span.duration).max(4.0 * span.interval);
        for phase in [0.0, PI / 2.0] {
            out.push(vec![0.01, 0.01, period, phase]);
        }
    }
    out
}

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
