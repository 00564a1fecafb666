//! An empirical force term: dv/dt = (ax, ay) x^px y^py vx^pvx vy^pvy |v|^pv.
//!
//! Source: the terms of laws found by sparse regression (Brunton, Proctor and Kutz, PNAS 113 (2016) 3932). A
//! diagnosis uses it to write a force that none of the named effects explains, so that it can be simulated;
//! the model search does not try it. Valid only within the range of the data that it was fitted to.
//!
//! Integrator: explicit Euler, v + a dt.
//!
//! Differences from the source: powers are integers from 0 to 4 (others are rounded). The unit of ax and ay
//! is m/s^2 divided by the units of the powers.

use super::vectorize::map_lanes;
use super::{
    ConstantLanes, Constants, Effect, EffectKind, LANES, MotionLaw, MotionState, MotionStateLanes,
    ParameterDeclaration, SearchStrategy, ShapeParameter, SimulationContext, amplitude, constants, effect,
    parameter, shape,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "monomial",
    summary: "An empirical force term: a monomial in position, velocity and speed.",
    signature: "Depends on the fit.",
    equation: "a = (ax, ay) x^px y^py vx^pvx vy^pvy |v|^pv, powers whole",
    parameters: &[
        parameter("ax", "m/s^2 over the powers' unit", [-1e3, 1e3], amplitude(0.1, 1.0, 2e-3)),
        parameter("ay", "m/s^2 over the powers' unit", [-1e3, 1e3], amplitude(0.1, 1.0, 2e-3)),
        power("px"),
        power("py"),
        power("pvx"),
        power("pvy"),
        power("pv"),
    ],
    search: SearchStrategy::Excluded,
    ..effect(EffectKind::Motion(&Monomial))
};

const fn power(name: &'static str) -> ParameterDeclaration {
    parameter(name, "1", [0.0, 4.0], shape(ShapeParameter::Power, 1.0, 2e-3))
}

struct Monomial;

impl MotionLaw for Monomial {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        let dt = context.time_step;
        let mut all = constants(parameters);
        (all[0], all[1]) = (parameters[0] * dt, parameters[1] * dt);
        all[2..].iter_mut().for_each(|power| *power = power.round());
        all
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let bases = [body.x, body.y, body.vx, body.vy, (body.vx * body.vx + body.vy * body.vy).sqrt()];
        let product: f64 = bases.iter().zip(&constants[2..]).map(|(b, p)| raised(*b, *p)).product();
        [body.vx + constants[0] * product, body.vy + constants[1] * product, body.omega]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        let [ax, ay, px, py, pvx, pvy, pv, ..] = constants;
        let MotionStateLanes { x, y, vx, vy, .. } = &*bodies;
        // Inlined; otherwise it would be called lane by lane.
        let product = map_lanes(
            #[inline(always)]
            |l| {
                let speed = (vx[l] * vx[l] + vy[l] * vy[l]).sqrt();
                let place = raised(x[l], px[l]) * raised(y[l], py[l]);
                place * raised(vx[l], pvx[l]) * raised(vy[l], pvy[l]) * raised(speed, pv[l])
            },
        );
        for lane in 0..LANES {
            bodies.vx[lane] += ax[lane] * product[lane];
            bodies.vy[lane] += ay[lane] * product[lane];
        }
    }
}

/// `base` to an integer power up to 4, by the same multiplications everywhere and without branches.
#[inline(always)]
fn raised(base: f64, power: f64) -> f64 {
    let square = base * base;
    let cube = square * base;
    let fourth = cube * base;
    let high = if power > 3.5 { fourth } else { cube };
    let low = if power > 1.5 { square } else { base };
    let any = if power > 2.5 { high } else { low };
    if power > 0.5 { any } else { 1.0 }
}
