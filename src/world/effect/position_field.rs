//! A linear force field: dv/dt = (kx (x0 - x), ky (y0 - y)).
//!
//! Source: Hooke's law; the first order of any smooth field about an equilibrium (a magnet under the table, a
//! bowl-shaped floor seen from above). **Sign: k > 0 attracts to (x0, y0)**, k < 0 repels; an axis with k = 0
//! is unaffected. Valid near that point.
//!
//! Integrator: engines move a body by its new velocity (symplectic Euler), whose oscillation under a kick K
//! dt (x0 - x) has the phase step theta with cos(theta) = 1 - K dt^2 / 2. With K = (2 sin(w dt / 2) / dt)^2
//! and w = sqrt(k), theta is w dt: oscillations have exactly the right period, and are stable for any step (w
//! dt is limited to 3). Likewise sinh for repulsion.
//!
//! Differences from the source: axes along x and y only. Its parameters x0 and y0 are in m.

use super::{
    ConstantLanes, Constants, DataRange, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    SearchStrategy, ShapeParameter, SimulationContext, amplitude, constants, effect, parameter, shape, wind,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "position_field",
    summary: "A linear force field: attraction to, or repulsion from, a point or line.",
    signature: "The force depends on the position only; attraction oscillates with period 2 pi / sqrt(k) \
        at any amplitude. With (x0, y0) far away it is wind.",
    equation: "a = (kx (x0 - x), ky (y0 - y)): k > 0 attracts, k < 0 repels",
    parameters: &[
        parameter("kx", "1/s^2", [-1000.0, 1000.0], amplitude(0.1, 1.0, 2e-3)),
        parameter("ky", "1/s^2", [-1000.0, 1000.0], amplitude(0.1, 1.0, 2e-3)),
        parameter("x0", "m", [-1e5, 1e5], shape(ShapeParameter::Place, 10.0, 2e-3)),
        parameter("y0", "m", [-1e5, 1e5], shape(ShapeParameter::Place, 10.0, 2e-3)),
    ],
    special_cases: &[&wind::EFFECT],
    search: SearchStrategy::FromStarts(starts),
    ..effect(EffectKind::Motion(&PositionField))
};

/// The centre and the corners of the observed area.
fn starts(span: &DataRange) -> Vec<Vec<f64>> {
    let [x0, y0, x1, y1] = span.area;
    let (width, height) = (x1 - x0, y1 - y0);
    let at = |[x, y]: [f64; 2]| vec![1e-2, 1e-2, x0 + x * width, y0 + y * height];
    [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(at).to_vec()
}

struct PositionField;

impl MotionLaw for PositionField {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let dt = context.time_step;
        constants(&[stiffness(parameters[0], dt), stiffness(parameters[1], dt), parameters[2], parameters[3]])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let [kx, ky, x0, y0] = [constants[0], constants[1], constants[2], constants[3]];
        [body.vx + kx * (x0 - body.x), body.vy + ky * (y0 - body.y), body.omega]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        let [kx, ky, x0, y0, ..] = constants;
        for lane in 0..LANES {
            bodies.vx[lane] += kx[lane] * (x0[lane] - bodies.x[lane]);
            bodies.vy[lane] += ky[lane] * (y0[lane] - bodies.y[lane]);
        }
    }
}

/// Upper limit of w dt: from pi an oscillation would grow.
const MAX_PHASE_STEP_RAD: f64 = 3.0;

/// K dt, 1/s: see the integrator above.
fn stiffness(k: f64, dt: f64) -> f64 {
    let half = k.abs().sqrt() * dt / 2.0;
    let swing = if k > 0.0 { libm::sin(half.min(MAX_PHASE_STEP_RAD / 2.0)) } else { libm::sinh(half) };
    k.signum() * 4.0 * swing * swing / dt
}
