//! A force field that grows with distance: dv/dt = (kx (x0 - x), ky (y0 - y)).
//!
//! Source: Hooke's law; the first order of any smooth field about a place where it vanishes (a magnet under
//! the table, a bowl-shaped floor seen from above). **Sign: k > 0 attracts to (x0, y0)**, k < 0 repels; an
//! axis with k = 0 is left alone. Valid near that place.
//!
//! Signature: the push depends on where the body is and on nothing else; attraction swings with period
//! 2 pi / sqrt(k) whatever the amplitude. With (x0, y0) far off it is wind.
//!
//! Integrator: engines move a body by its new velocity (symplectic Euler), whose swing under a kick
//! K dt (x0 - x) obeys cos(theta) = 1 - K dt^2 / 2. With K = (2 sin(w dt / 2) / dt)^2 and w = sqrt(k), theta is
//! w dt: swings have exactly the right period, and are stable for any step (w dt beyond 3 is taken for 3).
//! Likewise sinh for repulsion.
//!
//! Differences from the source: axes along x and y only. Its parameters x0 and y0 are in m.

use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Parameter, Search, Shape,
    Span, Surroundings, amplitude, constants, shape, wind,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "position_field",
    equation: "a = (kx (x0 - x), ky (y0 - y)): k > 0 attracts, k < 0 repels",
    parameters: &[
        Parameter {
            name: "kx",
            unit: "1/s^2",
            bounds: [-1000.0, 1000.0],
            neutral: 0.0,
            ..amplitude(0.1, 1.0, 2e-3)
        },
        Parameter {
            name: "ky",
            unit: "1/s^2",
            bounds: [-1000.0, 1000.0],
            neutral: 0.0,
            ..amplitude(0.1, 1.0, 2e-3)
        },
        Parameter {
            name: "x0",
            unit: "m",
            bounds: [-1e5, 1e5],
            neutral: 0.0,
            ..shape(Shape::Place, 10.0, 2e-3)
        },
        Parameter {
            name: "y0",
            unit: "m",
            bounds: [-1e5, 1e5],
            neutral: 0.0,
            ..shape(Shape::Place, 10.0, 2e-3)
        },
    ],
    act: Act::Motion(&PositionField),
    holds: &[&wind::EFFECT],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::From(starts),
};

/// About the middle of what was seen, and its corners.
fn starts(span: &Span) -> Vec<Vec<f64>> {
    let [x0, y0, x1, y1] = span.area;
    let (width, height) = (x1 - x0, y1 - y0);
    let at = |[x, y]: [f64; 2]| vec![1e-2, 1e-2, x0 + x * width, y0 + y * height];
    [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(at).to_vec()
}

struct PositionField;

impl Motion for PositionField {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        let dt = around.time_step;
        constants(&[stiffness(parameters[0], dt), stiffness(parameters[1], dt), parameters[2], parameters[3]])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let [kx, ky, x0, y0] = [constants[0], constants[1], constants[2], constants[3]];
        [body.vx + kx * (x0 - body.x), body.vy + ky * (y0 - body.y), body.omega]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        let [kx, ky, x0, y0, ..] = constants;
        for lane in 0..LANES {
            bodies.vx[lane] += kx[lane] * (x0[lane] - bodies.x[lane]);
            bodies.vy[lane] += ky[lane] * (y0[lane] - bodies.y[lane]);
        }
    }
}

/// Largest w dt that is taken for itself: at pi a swing would grow.
const STABLE: f64 = 3.0;

/// K dt, 1/s: see the integrator above.
fn stiffness(k: f64, dt: f64) -> f64 {
    let half = k.abs().sqrt() * dt / 2.0;
    let swing = if k > 0.0 { libm::sin(half.min(STABLE / 2.0)) } else { libm::sinh(half) };
    k.signum() * 4.0 * swing * swing / dt
}
