//! A sticky patch: linear drag for bodies whose centre is within a rectangle.
//!
//! Source: linear drag as in `linear_drag`, where the ground is carpet, sand or spilt honey. Valid for
//! patches larger than a step's way: a body that jumps over the patch within one step is not slowed.
//!
//! Signature: residuals begin at the same *place* in every trial, whatever the time and speed, and speed
//! decays exponentially there only.
//!
//! Integrator: exact within the patch, v exp(-c dt); edges are crossed at the end of a step.
//!
//! Differences from the source: the rectangle is bounded by its two corners in either order, edges included.
//! A body in flight over the patch is slowed as one on the ground: in the plane of the scene there is no
//! telling them apart.

use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Parameter, Search, Span,
    Surroundings, amplitude, constants, edge, linear_drag,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "sticky_patch",
    equation: "a = -c v, and the same for spin, where x_min <= x <= x_max and y_min <= y <= y_max",
    parameters: &[
        Parameter { name: "x_min", unit: "m", bounds: [-1e5, 1e5], neutral: 0.0, ..edge(0, 0, 10.0, 0.03) },
        Parameter { name: "x_max", unit: "m", bounds: [-1e5, 1e5], neutral: 0.0, ..edge(0, 1, 10.0, 0.03) },
        Parameter { name: "y_min", unit: "m", bounds: [-1e5, 1e5], neutral: 0.0, ..edge(1, 0, 10.0, 0.03) },
        Parameter { name: "y_max", unit: "m", bounds: [-1e5, 1e5], neutral: 0.0, ..edge(1, 1, 10.0, 0.03) },
        Parameter { name: "c", unit: "1/s", bounds: [0.0, 100.0], neutral: 0.0, ..amplitude(0.5, 2.0, 2e-3) },
    ],
    act: Act::Motion(&StickyPatch),
    holds: &[&linear_drag::EFFECT],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::From(starts),
};

/// Stretches of the way at any height, and on the floor, where the data reach down to it; then heights all along.
fn starts(span: &Span) -> Vec<Vec<f64>> {
    const CUTS: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];
    const SLIGHT: f64 = 0.05;
    let [x0, y0, x1, y1] = span.area;
    let (width, height) = (x1 - x0, y1 - y0);
    let (cut, margin) = (|i: usize| x0 + CUTS[i] * width, height.max(0.1));
    let mut out = Vec::new();
    for i in 0..CUTS.len() {
        for j in i + 1..CUTS.len() {
            if (i, j) != (0, 4) {
                out.push(vec![cut(i), cut(j), y0 - margin, y1 + margin, SLIGHT]);
            }
        }
    }
    for (i, j) in [(0, 2), (1, 3), (2, 4)] {
        out.push(vec![cut(i), cut(j), y0 - margin, y0 + 0.3 * height, SLIGHT]);
    }
    for (low, high) in [(-0.5, 0.33), (-0.5, 0.6), (0.4, 1.5)] {
        out.push(vec![x0 - width, x1 + width, y0 + low * height, y0 + high * height, SLIGHT]);
    }
    out
}

struct StickyPatch;

impl Motion for StickyPatch {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        let [x, y] = [[parameters[0], parameters[1]], [parameters[2], parameters[3]]];
        let kept = libm::exp(-parameters[4] * around.time_step);
        constants(&[x[0].min(x[1]), x[0].max(x[1]), y[0].min(y[1]), y[0].max(y[1]), kept])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let [x_min, x_max, y_min, y_max, kept] = std::array::from_fn(|i| constants[i]);
        let inside = (x_min <= body.x) & (body.x <= x_max) & (y_min <= body.y) & (body.y <= y_max);
        let kept = if inside { kept } else { 1.0 };
        [body.vx * kept, body.vy * kept, body.omega * kept]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        let [x_min, x_max, y_min, y_max, kept, ..] = constants;
        for lane in 0..LANES {
            let (x, y) = (bodies.x[lane], bodies.y[lane]);
            let inside = (x_min[lane] <= x) & (x <= x_max[lane]) & (y_min[lane] <= y) & (y <= y_max[lane]);
            let kept = if inside { kept[lane] } else { 1.0 };
            bodies.vx[lane] *= kept;
            bodies.vy[lane] *= kept;
            bodies.omega[lane] *= kept;
        }
    }
}
