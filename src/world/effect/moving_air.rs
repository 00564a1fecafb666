//! Moving air: quadratic drag relative to air that moves at (ux, uy), dv/dt = -k |v - u| (v - u).
//!
//! Source: as `quadratic_drag` (Batchelor, section 5.11), in the frame of the air.
//!
//! Signature: a body let go is blown along and ends at the air's own velocity (with gravity: at sqrt(g / k)
//! relative to it). Unlike wind the push fades as the body takes up speed, and unlike still-air drag it moves
//! what rests and treats opposite directions unequally.
//!
//! Integrator: exact for the drag alone, (v - u) / (1 + k |v - u| dt) + u, and so stable for any step.
//!
//! Differences from the source: spin is left alone; with k = 0 nothing happens whatever the air does.

use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Parameter, Search, Shape,
    Span, Surroundings, amplitude, constants, quadratic_drag, shape, wind,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "moving_air",
    equation: "a = -k |v - u| (v - u), u = (ux, uy)",
    parameters: &[
        Parameter {
            name: "ux",
            unit: "m/s",
            bounds: [-100.0, 100.0],
            neutral: 0.0,
            plausible: 3.0,
            ..shape(Shape::Velocity, 1.0, 1e-2)
        },
        Parameter {
            name: "uy",
            unit: "m/s",
            bounds: [-100.0, 100.0],
            neutral: 0.0,
            plausible: 3.0,
            ..shape(Shape::Velocity, 1.0, 1e-2)
        },
        Parameter {
            name: "k",
            unit: "1/m",
            bounds: [0.0, 1000.0],
            neutral: 0.0,
            ..amplitude(0.03, 0.2, 2e-3)
        },
    ],
    act: Act::Motion(&MovingAir),
    holds: &[&quadratic_drag::EFFECT, &wind::EFFECT],
    opposes_motion: true,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::From(starts),
};

/// Air that moves either way at half the usual speed, with a drag that takes a fiftieth of it.
fn starts(span: &Span) -> Vec<Vec<f64>> {
    let (u, k) = (0.5 * span.speed, 0.02 / (span.speed * span.duration).max(1e-9));
    vec![vec![u, 0.0, k], vec![-u, 0.0, k], vec![0.0, u, k], vec![0.0, -u, k]]
}

struct MovingAir;

impl Motion for MovingAir {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        constants(&[parameters[0], parameters[1], parameters[2] * around.time_step])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let (wx, wy) = (body.vx - constants[0], body.vy - constants[1]);
        let push = constants[2] * (wx * wx + wy * wy).sqrt();
        let lost = push / (1.0 + push);
        [body.vx - lost * wx, body.vy - lost * wy, body.omega]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        let [ux, uy, k_dt, ..] = constants;
        for lane in 0..LANES {
            let (vx, vy) = (bodies.vx[lane], bodies.vy[lane]);
            let (wx, wy) = (vx - ux[lane], vy - uy[lane]);
            let push = k_dt[lane] * (wx * wx + wy * wy).sqrt();
            let lost = push / (1.0 + push);
            bodies.vx[lane] = vx - lost * wx;
            bodies.vy[lane] = vy - lost * wy;
        }
    }
}
