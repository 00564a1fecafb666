//! Linear drag: dv/dt = -c v, and the same for spin.
//!
//! Source: the damping of Pymunk (Chipmunk2D manual, `cpSpaceSetDamping`), which keeps the share d of
//! velocity per second, so c = -ln d; the paper's real world has d = 0.8. Valid for creeping motion in a
//! viscous medium; here simply what the paper's simulation lacks.
//!
//! Signature: speed decays exponentially, at the same rate whatever the speed; only a second speed tells it
//! from quadratic drag. Spin decays along with it. Flight is slowed as rolling is.
//!
//! Integrator: exact, v exp(-c dt) = v d^dt, which is what Pymunk uses.
//!
//! Differences from the source: none.

use super::{
    Act, Constants, Effect, LANES, MOST_PARAMETERS, Motion, Moving, MovingLanes, Parameter, Search,
    Surroundings, amplitude, constants,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "linear_drag",
    equation: "a = -c v, and the same for spin",
    parameters: &[Parameter {
        name: "c",
        unit: "1/s",
        bounds: [0.0, 100.0],
        neutral: 0.0,
        ..amplitude(0.5, 0.7, 2e-3)
    }],
    act: Act::Motion(&LinearDrag),
    holds: &[],
    opposes_motion: true,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Downhill,
};

struct LinearDrag;

impl Motion for LinearDrag {
    fn constants(&self, parameters: &[f64], around: &Surroundings) -> Constants {
        constants(&[libm::exp(-parameters[0] * around.time_step)])
    }

    fn kick(&self, constants: &Constants, body: Moving, _dt: f64) -> [f64; 3] {
        let kept = constants[0];
        [body.vx * kept, body.vy * kept, body.omega * kept]
    }

    fn timeless(&self) -> bool {
        true
    }

    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, _dt: f64) {
        for (lane, kept) in constants[0].iter().enumerate() {
            bodies.vx[lane] *= kept;
            bodies.vy[lane] *= kept;
            bodies.omega[lane] *= kept;
        }
    }
}
