//! Linear drag: dv/dt = -c v, and the same for spin.
//!
//! Source: the damping of Pymunk (Chipmunk2D manual, `cpSpaceSetDamping`), which keeps the fraction d of
//! velocity per second, so c = -ln d; the paper's real world has d = 0.8. Valid for creeping motion in a
//! viscous medium; here it is the effect that the paper's simulation lacks.
//!
//! Integrator: exact, v exp(-c dt) = v d^dt, as in Pymunk.
//!
//! Differences from the source: none.

use super::{
    ConstantLanes, Constants, Effect, EffectKind, MotionLaw, MotionState, MotionStateLanes, PriorCoordinate,
    SimulationContext, amplitude, constants, effect, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "linear_drag",
    aliases: &["stokes_drag", "viscous_drag"],
    summary: "Linear drag: a deceleration proportional to the velocity.",
    signature: "Speed decays exponentially, at the same rate for all speeds; only trials of different \
        speeds distinguish it from quadratic drag. Spin decays at the same rate. It acts in flight \
        and in rolling.",
    equation: "a = -c v, and the same for spin",
    parameters: &[parameter(
        "c",
        "1/s",
        [0.0, 1e4],
        amplitude(0.5, 0.7, 2e-3).heavy_tailed(PriorCoordinate::Value),
    )],
    opposes_motion: true,
    ..effect(EffectKind::Motion(&LinearDrag))
};

struct LinearDrag;

impl MotionLaw for LinearDrag {
    fn constants(&self, parameters: &[f64], context: &SimulationContext) -> Constants {
        constants(&[libm::exp(-parameters[0] * context.time_step)])
    }

    fn kick(&self, constants: &Constants, body: MotionState, _dt: f64) -> [f64; 3] {
        let kept = constants[0];
        [body.vx * kept, body.vy * kept, body.omega * kept]
    }

    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, _dt: f64) {
        for (lane, kept) in constants[0].iter().enumerate() {
            bodies.vx[lane] *= kept;
            bodies.vy[lane] *= kept;
            bodies.omega[lane] *= kept;
        }
    }
}
