//! A sticky patch: linear drag for bodies whose centre is within a rectangle.
//!
//! Source: linear drag as in `linear_drag`, on ground such as carpet, sand or spilt honey. Valid for patches
//! larger than the distance travelled in a step: a body that crosses the patch within one step is not slowed.
//!
//! Integrator: exact within the patch, v exp(-c dt); edges are crossed at the end of a step.
//!
//! Differences from the source: the rectangle is given by its two corners in either order, edges included. A
//! body in flight above the patch is slowed like one on the ground: in the plane of the scene they cannot be
//! distinguished.

use super::{
    ConstantLanes, Constants, DataRange, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    SearchStrategy, SimulationContext, amplitude, constants, edge, effect, linear_drag, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "sticky_patch",
    summary: "A sticky patch: linear drag within a rectangle.",
    signature: "Residuals begin at the same position in every trial, at any time and speed, and speed \
        decays exponentially there only.",
    equation: "a = -c v, and the same for spin, where x_min <= x <= x_max and y_min <= y <= y_max",
    parameters: &[
        parameter("x_min", "m", [-1e5, 1e5], edge(0, 0, 10.0, 0.03)),
        parameter("x_max", "m", [-1e5, 1e5], edge(0, 1, 10.0, 0.03)),
        parameter("y_min", "m", [-1e5, 1e5], edge(1, 0, 10.0, 0.03)),
        parameter("y_max", "m", [-1e5, 1e5], edge(1, 1, 10.0, 0.03)),
        parameter("c", "1/s", [0.0, 100.0], amplitude(0.5, 2.0, 2e-3)),
    ],
    special_cases: &[&linear_drag::EFFECT],
    search: SearchStrategy::FromStarts(starts),
    ..effect(EffectKind::Motion(&StickyPatch))
};

/// Intervals of x at any height, and on the floor at the lower end of the data; then intervals of y at any x.
fn starts(span: &DataRange) -> Vec<Vec<f64>> {
    const CUTS: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];
    const START_COEFFICIENT_PER_S: f64 = 0.05;
    let [x0, y0, x1, y1] = span.area;
    let (width, height) = (x1 - x0, y1 - y0);
    let (cut, margin) = (|i: usize| x0 + CUTS[i] * width, height.max(0.1));
    let mut out = Vec::new();
    for i in 0..CUTS.len() {
        for j in i + 1..CUTS.len() {
            if (i, j) != (0, 4) {
                out.push(vec![cut(i), cut(j), y0 - margin, y1 + margin, START_COEFFICIENT_PER_S]);
            }
        }
    }
    for (i, j) in [(0, 2), (1, 3), (2, 4)] {
        out.push(vec![cut(i), cut(j), y0 - margin, y0 + 0.3 * height, START_COEFFICIENT_PER_S]);
    }
    for (low, high) in [(-0.5, 0.33), (-0.5, 0.6), (0.4, 1.5)] {
        out.push(vec![
            x0 - width,
            x1 + width,
            y0 + low * height,
            y0 + high * height,
            START_COEFFICIENT_PER_S,
        ]);
    }
    out
}

struct StickyPatch;

impl MotionLaw for StickyPatch {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let [x, y] = [[parameters[0], parameters[1]], [parameters[2], parameters[3]]];
        let kept = libm::exp(-parameters[4] * context.time_step);
        constants(&[x[0].min(x[1]), x[0].max(x[1]), y[0].min(y[1]), y[0].max(y[1]), kept])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let [x_min, x_max, y_min, y_max, kept] = std::array::from_fn(|i| constants[i]);
        let inside = (x_min <= body.x) & (body.x <= x_max) & (y_min <= body.y) & (body.y <= y_max);
        let kept = if inside { kept } else { 1.0 };
        [body.vx * kept, body.vy * kept, body.omega * kept]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
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
