//! Effects: physics beyond gravity and contact, one file each, listed in [`REGISTRY`].
//!
//! An effect's file says all there is to say of it: the law, in one of the forms of [`Act`]; its parameters with
//! units, bounds, the neutral values at which it vanishes, what each is to the effect ([`Role`]) and how large it
//! usually is; which other effects it holds, and how a search for causes tries it ([`Search`]). Engines call the
//! forms, and estimation and discovery read the declaration; none of them knows an effect by name.

mod bump;
mod camera_tilt;
pub mod clock_push;
mod declaration;
mod gravity_error;
pub mod gust;
mod lag;
mod law;
mod lift;
pub(super) mod linear_drag;
pub mod monomial;
mod moving_air;
pub mod place_drive;
pub mod place_push;
mod placement_offset;
mod position_field;
mod position_scale;
mod quadratic_drag;
mod restitution_speed;
mod restitution_threshold;
mod rolling_resistance;
mod spin_decay;
mod sticky_patch;
mod tangential_restitution;
mod time_scale;
pub mod velocity_push;
mod wide;
mod wind;

use std::fmt::Display;

use crate::error::{Error, Result, within};
use crate::task::scene::{EffectTerm, Scene};
pub use bump::bump;
pub use declaration::{ActsOn, Effect, Parameter, Role, Search, Shape, Span};
use declaration::{amplitude, edge, shape};
use law::constants;
pub use law::{
    Act, Answer, Constants, LANES, MOST_PARAMETERS, Meeting, Motion, Moving, MovingLanes, Placing, Sensor,
    Shown, Surroundings, Touch, rolled_off,
};

/// Every known effect.
pub static REGISTRY: &[&Effect] = &[
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
    &restitution_threshold::EFFECT,
    &tangential_restitution::EFFECT,
    &sticky_patch::EFFECT,
    &position_scale::EFFECT,
    &time_scale::EFFECT,
    &camera_tilt::EFFECT,
    &lag::EFFECT,
    &placement_offset::EFFECT,
    &spin_decay::EFFECT,
    &monomial::EFFECT,
    &place_push::EFFECT,
    &velocity_push::EFFECT,
    &clock_push::EFFECT,
    &place_drive::EFFECT,
];

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
pub fn resolve(term: &EffectTerm, place: impl Display) -> Result<Active> {
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
        let [low, high] = p.bounds;
        // Fields are put into words only where they are needed: this is done for every rollout.
        if (low..=high).contains(&v) {
            return Ok(v);
        }
        within(&format!("{place}.parameters.{}", p.name), v, low, high)
    };
    Ok(Active { effect, values: effect.parameters.iter().map(value).collect::<Result<_>>()? })
}

/// What acts in a scene, in the order in which it does: its damping, the threshold of its contact rules, its effects.
pub fn of_scene(scene: &Scene) -> Result<Vec<Active>> {
    let mut all = Vec::new();
    if let Some(kept) = scene.damping.filter(|kept| *kept < 1.0) {
        all.push(resolve(&damping(kept), "damping")?);
    }
    if let Some(rules) = scene.contact_rules.filter(|rules| rules.restitution_threshold > 0.0) {
        let term = restitution_threshold::EFFECT.at_clock(&[rules.restitution_threshold], 0.0);
        all.push(resolve(&term, "contact_rules")?);
    }
    for (i, term) in scene.effects.iter().enumerate() {
        all.push(resolve(term, format_args!("effects[{i}]"))?);
    }
    Ok(all)
}

/// Errors unless the effects of a scene can be; the field is within the scene.
pub fn check(terms: &[EffectTerm]) -> Result<()> {
    terms.iter().enumerate().try_for_each(|(i, term)| resolve(term, format_args!("effects[{i}]")).map(|_| ()))
}

/// Most effects of a set.
const MOST_OF_A_SET: usize = 4;

/// Errors unless these names are effects that may be asked about together; `field` is the set's.
pub fn check_set(field: &str, names: &[String]) -> Result<()> {
    if names.len() > MOST_OF_A_SET {
        let allowed = format!("at most {MOST_OF_A_SET}");
        return Err(Error::input(field, format!("{} effects", names.len()), allowed));
    }
    for (k, name) in names.iter().enumerate() {
        find(name)?;
        if names[..k].contains(name) {
            return Err(Error::input(field, format!("{name} twice"), "each effect once"));
        }
    }
    Ok(())
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
    linear_drag::EFFECT.at_clock(&[c], 0.0)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

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
            assert!(e.parameters.iter().any(Parameter::is_amplitude), "{} cannot vanish", e.name);
            assert!(e.holds.iter().all(|h| h.name != e.name && !h.holds(e)), "{}", e.name);
            for p in e.parameters {
                assert!(p.bounds[0] <= p.neutral && p.neutral <= p.bounds[1], "{}.{}", e.name, p.name);
                assert!(e.equation.contains(p.name), "{}: the equation lacks {}", e.name, p.name);
                let (mean, deviation) = p.prior();
                assert!((p.bounds[0]..=p.bounds[1]).contains(&mean), "{}.{}", e.name, p.name);
                assert!(deviation > p.step && p.step > 0.0, "{}.{}", e.name, p.name);
                assert!(p.size <= p.bounds[1] - p.bounds[0], "{}.{}", e.name, p.name);
            }
        }
    }

    /// Wherever a search starts, the effect can be simulated there, and does something: from nothing alone a search
    /// may go downhill.
    #[test]
    fn searches_start_where_the_effect_acts() {
        let span = Span { area: [-3.0, 0.0, 9.0, 4.0], duration: 2.0, speed: 3.0, interval: 0.05 };
        for e in REGISTRY {
            let Search::From(starts) = e.search else { continue };
            for values in starts(&span) {
                assert_eq!(values.len(), e.parameters.len(), "{}", e.name);
                resolve(&e.at_clock(&values, 0.7), "effect").unwrap();
                let acts = e.parameters.iter().zip(&values).any(|(p, v)| p.is_amplitude() && *v != p.neutral);
                assert!(acts, "{}: {values:?}", e.name);
            }
        }
    }

    /// What goes by the clock goes on where it was in a rollout that starts later: what swings, and what comes at a time. Other
    /// effects do not care.
    #[test]
    fn a_later_clock_turns_phases_and_shifts_times_alone() {
        for e in REGISTRY {
            let values: Vec<f64> = e.parameters.iter().map(|p| p.neutral).collect();
            let shifted = resolve(&e.at_clock(&values, 0.25), "effect").unwrap().values;
            for ((p, before), after) in e.parameters.iter().zip(&values).zip(shifted) {
                let turned = match p.role {
                    Role::Shape(Shape::Phase) => 2.0 * PI * 0.25,
                    Role::Shape(Shape::Time) => -0.25,
                    _ => 0.0,
                };
                assert_eq!(after, before + turned, "{}.{}", e.name, p.name);
            }
        }
    }

    /// A law that reads the clock pushes at a time as it does in a rollout that starts then.
    #[test]
    fn a_later_clock_changes_no_push() {
        let around = Surroundings { time_step: 1e-3, gravity: [0.0, -9.8] };
        for (e, law) in motions() {
            let values: Vec<f64> = e.parameters.iter().map(|p| value(p, 0.3)).collect();
            let shifted = resolve(&e.at_clock(&values, 0.4), "effect").unwrap().values;
            let kick = |values: &[f64], time: f64| {
                let body = Moving { time, ..moving([0.0, 0.3, 0.2, 1.5, -0.7, 0.1]) };
                law.kick(&law.constants(values, &around), body, around.time_step)
            };
            for (then, now) in kick(&values, 0.9).into_iter().zip(kick(&shifted, 0.5)) {
                assert!((then - now).abs() < 1e-12, "{}: {then} and {now}", e.name);
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
