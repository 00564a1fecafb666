//! Rolling resistance: a disc that rolls under a normal load N is decelerated by crr N / m, on level ground
//! by crr g.
//!
//! Source: Coulomb's law of rolling friction (Johnson, Contact Mechanics, section 9.1): the load acts
//! slightly ahead of the centre, and its moment opposes the rolling. crr is 0.001 for steel on steel, 0.002
//! to 0.01 for hard balls on tables, 0.1 on grass. Valid while the disc rolls and deforms little.
//!
//! Integrator: after the contacts of a step are resolved, centre and rim lose the same speed crr times the
//! step's normal impulse per mass, at most the rolling speed that they have in common: slip is unchanged, and
//! the motion is never reversed.
//!
//! Differences from the source: crr is the deceleration per load of centre and rim together. A moment crr' N
//! R alone would decelerate a rolling disc, with its spin, by crr' g / (1 + I / (m R^2)) = 2/3 crr' g.
//! Impacts do not count as load, nor do contacts between two movable bodies; bodies that are not discs do not
//! roll.

use super::{Constants, ContactLaw, Effect, EffectKind, amplitude, effect, parameter};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "rolling_resistance",
    summary: "Rolling resistance: a constant deceleration of rolling discs.",
    signature: "A rolling body loses speed at a constant rate, at any speed and mass, and stops within \
        v^2 / (2 crr g); drag is proportional to speed, and acts in flight as well. Sliding friction \
        is much stronger and ends when the body rolls.",
    equation: "a = -crr N/m against the rolling: crr g on level ground",
    parameters: &[parameter("crr", "1", [0.0, 10.0], amplitude(0.1, 0.05, 2e-3))],
    ..effect(EffectKind::Contact(&RollingResistance))
};

struct RollingResistance;

impl ContactLaw for RollingResistance {
    fn rolling_loss(&self, constants: &Constants, load: f64) -> f64 {
        constants[0] * load
    }
}
