//! Rolling resistance: a disc that rolls under a normal load N is slowed by crr N / m, on the level by crr g.
//!
//! Source: Coulomb's law of rolling friction (Johnson, Contact Mechanics, section 9.1): the load acts a
//! little ahead of the middle, and turns against the rolling. crr is 0.001 for steel on steel, 0.002 to 0.01
//! for hard balls on tables, 0.1 on grass. Valid while the disc rolls and deforms little.
//!
//! Signature: a rolling body loses speed at a constant rate, whatever its speed and mass, and stops within
//! v^2 / (2 crr g); drag takes speed in proportion, and acts in flight too. Sliding friction is much stronger
//! and ends when the body rolls.
//!
//! Integrator: after the contacts of a step are resolved, centre and rim lose the same speed crr times the
//! step's normal impulse over the mass, but no more than the rolling speed they have in common: slip is left
//! as it is, and nothing is ever turned round.
//!
//! Differences from the source: crr is the deceleration by load, of centre and rim together. A moment crr' N
//! R alone would slow a rolling disc, with its spin, by crr' g / (1 + I / (m R^2)) = 2/3 crr' g. Impacts do
//! not count as load, nor do contacts between two movable bodies; bodies that are not discs do not roll.

use super::{Act, Constants, Effect, Parameter, Search, Touch, amplitude};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "rolling_resistance",
    equation: "a = -crr N/m against the rolling: crr g on level ground",
    parameters: &[Parameter {
        name: "crr",
        unit: "1",
        bounds: [0.0, 10.0],
        neutral: 0.0,
        ..amplitude(0.1, 0.05, 2e-3)
    }],
    act: Act::Contact(&RollingResistance),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Downhill,
};

struct RollingResistance;

impl Touch for RollingResistance {
    fn roll(&self, constants: &Constants, load: f64) -> f64 {
        constants[0] * load
    }
}
