//! Effects: physics beyond gravity and contact, one file each, listed in [`REGISTRY`].
//!
//! An effect declares its parameters with units, bounds and the neutral values at which it vanishes, and
//! acts through one of the forms of [`Act`]. Engines call the forms; no engine knows an effect by name.

mod camera_tilt;
mod gravity_error;
pub mod gust;
mod lag;
mod lift;
mod linear_drag;
pub mod monomial;
mod moving_air;
mod placement_offset;
mod position_field;
mod position_scale;
mod quadratic_drag;
mod restitution_speed;
mod rolling_resistance;
mod sticky_patch;
mod tangential_restitution;
mod time_scale;
mod wind;

use crate::error::{Error, Result, within};
use crate::task::scene::EffectTerm;

/// Every known effect.
pub static REGISTRY: [&Effect; 18] = [
    &linear_drag::EFFECT,
    &quadratic_drag::EFFECT,
    &wind::EFFECT,
    &moving_air::EFFECT,
    &gravity_error::EFFECT,
    &lift::EFFECT,
    &gust::EFFECT,
    &position_field::EFFECT,
    &rolling_resistance::EFFECT,
    &restitution_speed::EFFECT,
    &tangential_restitution::EFFECT,
    &sticky_patch::EFFECT,
    &position_scale::EFFECT,
    &time_scale::EFFECT,
    &camera_tilt::EFFECT,
    &lag::EFFECT,
    &placement_offset::EFFECT,
    &monomial::EFFECT,
];

/// One effect: what it is called, what it takes, what it does.
pub struct Effect {
    /// Name in scenes and reports.
    pub name: &'static str,
    /// What the effect acts on: `motion`, `contact`, `region`, `sensor` or `action`.
    pub acts_on: &'static str,
    /// The law in words and symbols.
    pub equation: &'static str,
    /// Parameters in the order of the values that `act` is given.
    pub parameters: &'static [Parameter],
    /// What it does.
    pub act: Act,
}

/// A parameter of an effect.
pub struct Parameter {
    /// Name in scenes and reports.
    pub name: &'static str,
    /// SI unit.
    pub unit: &'static str,
    /// Allowed values, inclusive.
    pub bounds: [f64; 2],
    /// Value at which the effect vanishes.
    pub neutral: f64,
}

/// The forms in which an effect can act.
#[derive(Clone, Copy)]
pub enum Act {
    /// Changes a body's velocity once per time step, before gravity and contacts.
    Motion(&'static dyn Motion),
    /// Changes what contacts give back, or slows what rolls on them.
    Contact(&'static dyn Touch),
    /// Changes what is seen of a rollout: see `world::observe`.
    Sensor(&'static dyn Sensor),
    /// Changes where things start that an action places.
    Action(&'static dyn Placing),
}

/// Number of rollouts the batched kernel advances together.
pub const LANES: usize = 8;

/// What an effect may know of the rollout it acts in.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings {
    /// s
    pub time_step: f64,
    /// m/s^2
    pub gravity: [f64; 2],
}

/// A law of motion, written for one body; engines that advance many at once use [`Motion::kick_lanes`].
pub trait Motion: Sync {
    /// What is worth computing once per rollout; by default the parameters as they are. Constants that are
    /// all 0 stand for an empty lane, and must give finite kicks.
    fn constants(&self, parameters: &[f64], _around: &Surroundings) -> Constants {
        constants(parameters)
    }

    /// (vx, vy, omega) after `dt` seconds of the effect alone. Pure: the same bits for the same arguments.
    fn kick(&self, constants: &Constants, body: Moving, dt: f64) -> [f64; 3];

    /// Whether [`Motion::kick`] ignores the clock: only then may an engine take a state that a step leaves
    /// unchanged for the rollout's last word.
    fn timeless(&self) -> bool {
        false
    }

    /// [`Motion::kick`] for every lane of a batch: `constants[c][lane]`. An override must return the same
    /// bits.
    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, dt: f64) {
        #[expect(clippy::needless_range_loop, reason = "a lane is a column of every array")]
        for lane in 0..LANES {
            let own: Constants = std::array::from_fn(|c| constants[c][lane]);
            let body = Moving {
                time: bodies.time[lane],
                x: bodies.x[lane],
                y: bodies.y[lane],
                vx: bodies.vx[lane],
                vy: bodies.vy[lane],
                omega: bodies.omega[lane],
            };
            let [vx, vy, omega] = self.kick(&own, body, dt);
            (bodies.vx[lane], bodies.vy[lane], bodies.omega[lane]) = (vx, vy, omega);
        }
    }
}

/// A law of contact. Engines ask [`Touch::meet`] at the beginning of a step, about every contact that pushes,
/// and [`Touch::roll`] when its contacts are resolved.
pub trait Touch: Sync {
    /// As [`Motion::constants`].
    fn constants(&self, parameters: &[f64], _around: &Surroundings) -> Constants {
        constants(parameters)
    }

    /// What the contact is to give back in this step; `answer` is what it would without this law.
    fn meet(&self, _constants: &Constants, _meeting: Meeting, answer: Answer) -> Answer {
        answer
    }

    /// m/s to be taken off a disc's rolling speed, given the normal impulse of a step over the disc's mass,
    /// m/s.
    fn roll(&self, _constants: &Constants, _load: f64) -> f64 {
        0.0
    }
}

/// A contact at the beginning of a step.
#[derive(Clone, Copy, Debug)]
pub struct Meeting {
    /// Speed of approach along the normal, m/s; 0 if the surfaces part.
    pub approach: f64,
    /// Tangential speed of one surface along the other, m/s.
    pub slip: f64,
    /// Whether the contact bore no load in the step before.
    pub begins: bool,
}

/// What a contact gives back.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    /// Share of the speed of approach, in [0, 1].
    pub restitution: f64,
    /// Tangential speed of one surface along the other that friction drives at, m/s, in the sense of
    /// [`Meeting::slip`].
    pub slip: f64,
}

/// What a disc of `radius` (m) with a centre speed `along` a static (m/s) and spin `omega` (rad/s) loses of
/// each when `off` (m/s) is taken off its rolling: the speed that centre and rim have in common.
pub fn rolled_off(along: f64, omega: f64, radius: f64, off: f64) -> [f64; 2] {
    let rim = radius * omega;
    if along * rim <= 0.0 {
        return [0.0; 2];
    }
    let lost = along.signum() * off.min(along.abs()).min(rim.abs());
    [lost, lost / radius]
}

/// A sensor: what is seen of the truth, as a function of time and state.
pub trait Sensor: Sync {
    /// As [`Motion::constants`].
    fn constants(&self, parameters: &[f64], _around: &Surroundings) -> Constants {
        constants(parameters)
    }

    /// (rate, offset in s): what is stamped t was true at rate * t + offset; rate > 0.
    fn clock(&self, _constants: &Constants) -> [f64; 2] {
        [1.0, 0.0]
    }

    /// What is seen of a state.
    fn show(&self, _constants: &Constants, state: Shown) -> Shown {
        state
    }
}

/// The state of a body as a sensor shows it: m, rad, m/s, rad/s.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    pub x: f64,
    pub y: f64,
    pub angle: f64,
    pub vx: f64,
    pub vy: f64,
    pub omega: f64,
}

/// How what an action asks for is carried out.
pub trait Placing: Sync {
    /// As [`Motion::constants`].
    fn constants(&self, parameters: &[f64], _around: &Surroundings) -> Constants {
        constants(parameters)
    }

    /// Where a thing ends up that was to be placed at `asked`, m.
    fn placed(&self, constants: &Constants, asked: [f64; 2]) -> [f64; 2];
}

/// Most parameters an effect may have.
pub const MOST_PARAMETERS: usize = 8;
/// What [`Motion::constants`] computes.
pub type Constants = [f64; MOST_PARAMETERS];

/// The values, and 0 where there are fewer than [`MOST_PARAMETERS`].
fn constants(values: &[f64]) -> Constants {
    let mut all = [0.0; MOST_PARAMETERS];
    all[..values.len()].copy_from_slice(values);
    all
}

/// What a law of motion may depend on.
#[derive(Clone, Copy, Debug)]
pub struct Moving {
    /// s since the start of the rollout
    pub time: f64,
    /// m
    pub x: f64,
    /// m
    pub y: f64,
    /// m/s
    pub vx: f64,
    /// m/s
    pub vy: f64,
    /// rad/s
    pub omega: f64,
}

/// [`Moving`] for a batch.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct MovingLanes {
    pub time: [f64; LANES],
    pub x: [f64; LANES],
    pub y: [f64; LANES],
    pub vx: [f64; LANES],
    pub vy: [f64; LANES],
    pub omega: [f64; LANES],
}

/// An effect with its parameter values, in the registry's order.
#[derive(Clone)]
pub struct Active {
    /// The registry's row.
    pub effect: &'static Effect,
    /// One value per parameter.
    pub values: Vec<f64>,
}

impl Active {
    /// Whether every parameter has its neutral value.
    pub fn is_neutral(&self) -> bool {
        self.effect.parameters.iter().zip(&self.values).all(|(p, v)| *v == p.neutral)
    }
}

/// Looks up a term and checks its parameters; `place` prefixes the error's field.
pub fn resolve(term: &EffectTerm, place: &str) -> Result<Active> {
    let effect = find(&term.name).map_err(|_| {
        let known = REGISTRY.iter().map(|e| e.name).collect::<Vec<_>>().join(", ");
        Error::input(format!("{place}.name"), format!("{:?}", term.name), format!("one of {known}"))
    })?;
    for given in term.parameters.keys() {
        if !effect.parameters.iter().any(|p| p.name == given) {
            let known = effect.parameters.iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
            let field = format!("{place}.parameters.{given}");
            return Err(Error::input(field, "unknown", format!("parameters of {}: {known}", effect.name)));
        }
    }
    let value = |p: &Parameter| {
        let v = term.parameters.get(p.name).copied().unwrap_or(p.neutral);
        within(&format!("{place}.parameters.{}", p.name), v, p.bounds[0], p.bounds[1])
    };
    Ok(Active { effect, values: effect.parameters.iter().map(value).collect::<Result<_>>()? })
}

/// The effect named `name`.
pub fn find(name: &str) -> Result<&'static Effect> {
    REGISTRY.iter().copied().find(|e| e.name == name).ok_or_else(|| Error::NotFound {
        kind: "effect",
        id: name.to_string(),
        known: REGISTRY.iter().map(|e| e.name.to_string()).collect(),
    })
}

/// The term that a kept share of velocity per second stands for (Pymunk's damping).
pub fn damping(kept: f64) -> EffectTerm {
    linear_drag(-kept.ln())
}

/// Linear drag with coefficient `c`, 1/s.
pub fn linear_drag(c: f64) -> EffectTerm {
    EffectTerm { name: "linear_drag".into(), parameters: [("c".to_string(), c)].into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn motions() -> impl Iterator<Item = (&'static Effect, &'static dyn Motion)> {
        REGISTRY.iter().filter_map(|e| match e.act {
            Act::Motion(law) => Some((*e, law)),
            Act::Contact(_) | Act::Sensor(_) | Act::Action(_) => None,
        })
    }

    /// The value `share` of the way from the lower to the upper bound; dense near the neutral value for small
    /// shares.
    fn value(p: &Parameter, share: f64) -> f64 {
        let [low, high] = p.bounds;
        if share < 0.5 {
            (p.neutral + (share - 0.25) * 4.0).clamp(low, high)
        } else {
            low + (share - 0.5) * 2.0 * (high - low)
        }
    }

    fn moving(s: [f64; 6]) -> Moving {
        Moving { time: s[0].abs(), x: s[1], y: s[2], vx: s[3], vy: s[4], omega: s[5] }
    }

    #[test]
    fn rows_are_in_order() {
        for (i, e) in REGISTRY.iter().enumerate() {
            assert!(REGISTRY[..i].iter().all(|other| other.name != e.name), "{} twice", e.name);
            assert!(e.parameters.len() <= MOST_PARAMETERS, "{}", e.name);
            assert!(["motion", "contact", "region", "sensor", "action"].contains(&e.acts_on), "{}", e.name);
            for p in e.parameters {
                assert!(p.bounds[0] <= p.neutral && p.neutral <= p.bounds[1], "{}.{}", e.name, p.name);
                assert!(e.equation.contains(p.name), "{}: the equation lacks {}", e.name, p.name);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn lanes_are_kicked_as_one_body_is(
            shares in prop::collection::vec(prop::array::uniform8(0.0..1.0f64), LANES),
            states in prop::collection::vec(prop::array::uniform6(-30.0..30.0f64), LANES),
            dt in 1e-4..0.1f64,
        ) {
            let around = Surroundings { time_step: dt, gravity: [0.3, -9.8] };
            for (effect, law) in motions() {
                let own: Vec<Constants> = shares.iter().map(|s| {
                    let values = effect.parameters.iter().zip(s).map(|(p, s)| value(p, *s));
                    let values: Vec<f64> = values.collect();
                    law.constants(&values, &around)
                }).collect();
                let lanes = std::array::from_fn(|c| std::array::from_fn(|l| own[l][c]));
                let of = |k: usize| std::array::from_fn(|l| states[l][k]);
                let time = of(0).map(f64::abs);
                let mut batch =
                    MovingLanes { time, x: of(1), y: of(2), vx: of(3), vy: of(4), omega: of(5) };
                law.kick_lanes(&lanes, &mut batch, dt);
                for l in 0..LANES {
                    let one = law.kick(&own[l], moving(states[l]), dt);
                    let ours = [batch.vx[l], batch.vy[l], batch.omega[l]];
                    prop_assert_eq!(one.map(f64::to_bits), ours.map(f64::to_bits), "{}", effect.name);
                    prop_assert!(one.iter().all(|v| v.is_finite()), "{}: {:?}", effect.name, one);
                }
            }
        }

        #[test]
        fn neutral_values_change_nothing(state in prop::array::uniform6(-30.0..30.0f64), dt in 1e-4..0.1f64) {
            let around = Surroundings { time_step: dt, gravity: [0.3, -9.8] };
            for (effect, law) in motions() {
                let values: Vec<f64> = effect.parameters.iter().map(|p| p.neutral).collect();
                let after = law.kick(&law.constants(&values, &around), moving(state), dt);
                prop_assert_eq!(after.map(f64::to_bits), [state[3], state[4], state[5]].map(f64::to_bits),
                    "{}", effect.name);
                let idle = law.kick(&[0.0; MOST_PARAMETERS], moving([0.0; 6]), dt);
                prop_assert!(idle.iter().all(|v| v.is_finite()), "{}: an empty lane", effect.name);
            }
        }
    }
}
