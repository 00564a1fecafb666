//! Quadratic drag: dv/dt = -k |v| v.
//!
//! Source: Newton's law of resistance (Batchelor, An Introduction to Fluid Dynamics, section 5.11): the drag
//! on a body of cross-section A is rho C_D A v^2 / 2, so k = rho C_D A / (2 m): 0.13 / m for a table-tennis
//! ball, 0.006 for a baseball. Valid while C_D is constant: for spheres at Reynolds numbers of 1e3 to 2e5.
//!
//! Signature: the share of speed lost grows with the speed, so speeds fall as 1/t and not exponentially, and
//! there is a terminal speed sqrt(g / k). Against linear drag only trials of unlike speeds tell; against
//! wind, trials in opposite directions.
//!
//! Integrator: exact for the drag alone, v / (1 + k |v| dt), and so stable for any step.
//!
//! Differences from the source: spin is left alone.

use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Parameter, Search,
    Surroundings, amplitude, constants,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "quadratic_drag",
    equation: "a = -k |v| v",
    parameters: &[Parameter {
        name: "k",
        unit: "1/m",
        bounds: [0.0, 1000.0],
        neutral: 0.0,
        ..amplitude(0.03, 0.2, 2e-3)
    }],
    act: Act::Motion(&QuadraticDrag),
    holds: &[],
    opposes_motion: true,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Downhill,
};

struct QuadraticDrag;

impl Motion for QuadraticDrag {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        constants(&[parameters[0] * around.time_step])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let speed = (body.vx * body.vx + body.vy * body.vy).sqrt();
        let kept = 1.0 / (1.0 + constants[0] * speed);
        [body.vx * kept, body.vy * kept, body.omega]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        for (lane, k_dt) in constants[0].iter().enumerate() {
            let (vx, vy) = (bodies.vx[lane], bodies.vy[lane]);
            let kept = 1.0 / (1.0 + k_dt * (vx * vx + vy * vy).sqrt());
            bodies.vx[lane] = vx * kept;
            bodies.vy[lane] = vy * kept;
        }
    }
}
