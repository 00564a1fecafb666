//! Wind: a uniform push, dv/dt = (ax, ay).
//!
//! Source: the limit of moving air that is much faster than the body, where drag no longer depends on the
//! body's own velocity; also what a charged body feels between plates. Valid for bodies slow beside the air.
//!
//! Signature: free flight stays a parabola, tilted: the same acceleration for every trial, place and speed.
//! Along gravity it cannot be told from an error of gravity; across it, a tilted camera turns *what is at
//! rest* too (floors, and the line between two balls), which wind leaves alone.
//!
//! Integrator: exact, v + a dt.
//!
//! Differences from the source: independent of shape and mass.

use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Parameter, Search,
    Surroundings, amplitude, constants, gravity_error, position_scale, time_scale,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "wind",
    equation: "a = (ax, ay)",
    parameters: &[
        Parameter {
            name: "ax",
            unit: "m/s^2",
            bounds: [-100.0, 100.0],
            neutral: 0.0,
            ..amplitude(1.0, 1.0, 1e-2)
        },
        Parameter {
            name: "ay",
            unit: "m/s^2",
            bounds: [-100.0, 100.0],
            neutral: 0.0,
            ..amplitude(1.0, 1.0, 1e-2)
        },
    ],
    act: Act::Motion(&Wind),
    holds: &[&gravity_error::EFFECT, &position_scale::EFFECT, &time_scale::EFFECT],
    opposes_motion: false,
    differs: &[0.1, 0.1],
    renewed: false,
    check: None,
    search: Search::Downhill,
};

struct Wind;

impl Motion for Wind {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        constants(&[parameters[0] * around.time_step, parameters[1] * around.time_step])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        [body.vx + constants[0], body.vy + constants[1], body.omega]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        let [x, y, ..] = constants;
        for lane in 0..LANES {
            bodies.vx[lane] += x[lane];
            bodies.vy[lane] += y[lane];
        }
    }
}
