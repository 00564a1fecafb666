//! Gravity is not what the scene says: dv/dt = dg along gravity.
//!
//! Source: plain: the scene's g is one place's, local g differs by 0.5 % over the Earth, and a tilted table
//! or an immersed body (buoyancy: dg = -g rho_fluid / rho_body) by any amount. Valid where the error is
//! uniform.
//!
//! Signature: free flight stays a parabola along gravity of another curvature; fall times scale as sqrt(g /
//! (g + dg)) at any height, and weight on the floor changes too (friction stops sliding things sooner). An
//! error of the length scale also changes the curvature, but sideways motion as well.
//!
//! Integrator: exact, v + dg dt.
//!
//! Differences from the source: none. In a scene without gravity there is no direction, and no effect.

use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Parameter, Search,
    Surroundings, amplitude, constants,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "gravity_error",
    equation: "a = dg g/|g|, g being the scene's gravity: dg > 0 pulls harder",
    parameters: &[Parameter {
        name: "dg",
        unit: "m/s^2",
        bounds: [-100.0, 100.0],
        neutral: 0.0,
        ..amplitude(1.0, 0.5, 1e-2)
    }],
    act: Act::Motion(&GravityError),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Downhill,
};

struct GravityError;

impl Motion for GravityError {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        let [gx, gy] = around.gravity;
        let g = (gx * gx + gy * gy).sqrt();
        if g > 0.0 {
            let gained = parameters[0] * around.time_step;
            constants(&[gained * (gx / g), gained * (gy / g)])
        } else {
            constants(&[])
        }
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
