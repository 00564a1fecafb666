//! A push without a name: dv/dt = (ax, ay) x^px y^py vx^pvx vy^pvy |v|^pv.
//!
//! Source: the terms of which laws found by sparse regression are sums (Brunton, Proctor and Kutz, PNAS 113 (2016) 3932).
//! It is how a diagnosis writes down a force that none of the named effects accounts for, so that it can be simulated
//! all the same; no search for causes tries it. Valid where the data were that it was fitted to, and no further.
//!
//! Signature: whatever it was fitted to.
//!
//! Integrator: explicit Euler, v + a dt.
//!
//! Differences from the source: powers are whole numbers from 0 to 4 (others are rounded). The unit of ax and ay is
//! m/s^2 over that of the powers.

use super::wide::lanes;
use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Parameter, Search, Shape,
    Surroundings, amplitude, constants, shape,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "monomial",
    equation: "a = (ax, ay) x^px y^py vx^pvx vy^pvy |v|^pv, powers whole",
    parameters: &[
        Parameter {
            name: "ax",
            unit: "m/s^2 over the powers' unit",
            bounds: [-1e3, 1e3],
            neutral: 0.0,
            ..amplitude(0.1, 1.0, 2e-3)
        },
        Parameter {
            name: "ay",
            unit: "m/s^2 over the powers' unit",
            bounds: [-1e3, 1e3],
            neutral: 0.0,
            ..amplitude(0.1, 1.0, 2e-3)
        },
        power("px"),
        power("py"),
        power("pvx"),
        power("pvy"),
        power("pv"),
    ],
    act: Act::Motion(&Monomial),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Never,
};

const fn power(name: &'static str) -> Parameter {
    Parameter { name, unit: "1", bounds: [0.0, 4.0], neutral: 0.0, ..shape(Shape::Power, 1.0, 2e-3) }
}

struct Monomial;

impl Motion for Monomial {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        let dt = around.time_step;
        let mut all = constants(parameters);
        (all[0], all[1]) = (parameters[0] * dt, parameters[1] * dt);
        all[2..].iter_mut().for_each(|power| *power = power.round());
        all
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let bases = [body.x, body.y, body.vx, body.vy, (body.vx * body.vx + body.vy * body.vy).sqrt()];
        let product: f64 = bases.iter().zip(&constants[2..]).map(|(b, p)| raised(*b, *p)).product();
        [body.vx + constants[0] * product, body.vy + constants[1] * product, body.omega]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        let [ax, ay, px, py, pvx, pvy, pv, ..] = constants;
        let MovingLanes { x, y, vx, vy, .. } = &*bodies;
        // Inlined, or it would be called lane by lane.
        let product = lanes(
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

/// `base` to a whole power up to 4, by the same multiplications everywhere and without branches.
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
