//! Gusts: a uniform force that oscillates in time, dv/dt = (ax, ay) sin(2 pi t / period + phase).
//!
//! Source: the first harmonic of any periodic disturbance (a fan, a shaken table seen from its own frame).
//! Time is the rollout's: t = 0 at its start. Valid for a force that is uniform in space.
//!
//! Integrator: exact, the integral of the force over the step.
//!
//! Differences from the source: one harmonic. The phase is the same in every rollout.

use std::f64::consts::PI;

use super::{
    Constants, DataRange, Effect, EffectKind, MotionLaw, MotionState, SearchStrategy, ShapeParameter,
    SimulationContext, amplitude, constants, effect, parameter, shape, wind,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "gust",
    summary: "Gusts: a uniform force that oscillates in time.",
    signature: "Bodies at the same position and velocity are accelerated differently at different times; \
        residuals of all bodies and trials align over time and over no other variable. With a period \
        much longer than the trials it is wind.",
    equation: "a = (ax, ay) sin(2 pi t / period + phase), t from the start of the rollout",
    parameters: &[
        parameter("ax", "m/s^2", [-100.0, 100.0], amplitude(1.0, 2.0, 1e-2)),
        parameter("ay", "m/s^2", [-100.0, 100.0], amplitude(1.0, 2.0, 1e-2)),
        parameter("period", "s", [1e-3, 1e6], shape(ShapeParameter::Period, 1.0, 1e-4).neutral_at(1.0)),
        parameter("phase", "rad", [-100.0, 100.0], shape(ShapeParameter::Phase, 1.0, 2e-3)),
    ],
    special_cases: &[&wind::EFFECT],
    search: SearchStrategy::FromStarts(starts),
    ..effect(EffectKind::Motion(&Gust))
};

/// Periods from a few observations to more than a trial, in steps of a factor 1.6, at two phases.
fn starts(span: &DataRange) -> Vec<Vec<f64>> {
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

impl MotionLaw for Gust {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let [ax, ay, period, phase] = [parameters[0], parameters[1], parameters[2], parameters[3]];
        // The integral of the sine over a step is the sine at its middle, times the step, times
        // sin(h) / h.
        let half = PI * context.time_step / period;
        let gained = context.time_step * libm::sin(half) / half;
        constants(&[ax * gained, ay * gained, 2.0 * PI / period, phase + half])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let [x, y, rate, phase] = [constants[0], constants[1], constants[2], constants[3]];
        let swing = libm::sin(rate * body.time + phase);
        [body.vx + x * swing, body.vy + y * swing, body.omega]
    }

    fn is_autonomous(&self) -> bool {
        false
    }
}
