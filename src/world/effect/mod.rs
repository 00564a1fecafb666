//! Effects: physics beyond gravity and contact, one file each, listed in [`REGISTRY`].
//!
//! An effect's file defines everything about it: the law, as one of the [`EffectKind`]s; its parameters with
//! units, bounds, the neutral values at which it vanishes, their roles ([`ParameterRole`]) and typical sizes;
//! its special cases, and how the model search starts it ([`SearchStrategy`]). Engines call the laws;
//! estimation and diagnosis use the declaration; neither refers to an effect by name.

mod buoyancy;
mod camera_tilt;
pub mod clock_push;
mod declaration;
pub mod dispatch;
mod gravity_error;
mod ground_friction;
pub mod gust;
mod inertia_error;
mod lag;
mod law;
mod lens;
mod lift;
pub(super) mod linear_drag;
mod mass_ratio;
pub mod monomial;
mod moving_air;
pub mod place_drive;
pub mod place_push;
mod placement_offset;
mod position_field;
mod position_scale;
mod quadratic_drag;
mod rbf;
mod restitution_speed;
mod restitution_threshold;
mod rolling_resistance;
mod spin_decay;
mod sticky_patch;
mod tangential_restitution;
#[cfg(not(kernel))]
mod terms;
mod time_scale;
mod vectorize;
pub mod velocity_push;
mod wind;

pub use declaration::{
    DataRange, Effect, EffectTarget, IdentifyingMotion, ParameterDeclaration, ParameterRole, PriorCoordinate,
    SearchStrategy, ShapeParameter,
};
use declaration::{amplitude, edge, effect, parameter, scale_factor, shape};
use law::constants;
pub use law::{
    BodyLaw, ConstantLanes, Constants, ContactLaw, ContactResponse, ContactState, EffectKind, LANES,
    MAX_PARAMETERS, MassProperties, Measurement, MotionLaw, MotionState, MotionStateLanes, PlacementLaw,
    Sensor, SimulationContext, rolling_velocity_loss,
};
pub use rbf::gaussian;
#[cfg(not(kernel))]
pub use terms::{
    ActiveEffect, damping, find, find_alias, linear_drag, resolve, scene_effects, validate_set,
    validate_terms,
};

/// Every effect.
pub static REGISTRY: &[&Effect] = &[
    &linear_drag::EFFECT,
    &quadratic_drag::EFFECT,
    &wind::EFFECT,
    &moving_air::EFFECT,
    &gravity_error::EFFECT,
    &buoyancy::EFFECT,
    &lift::EFFECT,
    &gust::EFFECT,
    &position_field::EFFECT,
    &ground_friction::EFFECT,
    &rolling_resistance::EFFECT,
    &restitution_speed::EFFECT,
    &restitution_threshold::EFFECT,
    &tangential_restitution::EFFECT,
    &mass_ratio::EFFECT,
    &inertia_error::EFFECT,
    &sticky_patch::EFFECT,
    &position_scale::EFFECT,
    &time_scale::EFFECT,
    &camera_tilt::EFFECT,
    &lens::EFFECT,
    &lag::EFFECT,
    &placement_offset::EFFECT,
    &spin_decay::EFFECT,
    &monomial::EFFECT,
    &place_push::EFFECT,
    &velocity_push::EFFECT,
    &clock_push::EFFECT,
    &place_drive::EFFECT,
];

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use proptest::prelude::*;

    fn motions() -> impl Iterator<Item = (&'static Effect, &'static dyn MotionLaw)> {
        REGISTRY.iter().filter_map(|e| match e.kind {
            EffectKind::Motion(law) => Some((*e, law)),
            EffectKind::Contact(_) | EffectKind::Body(_) | EffectKind::Sensor(_) | EffectKind::Action(_) => {
                None
            }
        })
    }

    /// A value at the fraction `share` between the bounds; dense near the neutral value for small
    /// fractions.
    fn value(p: &ParameterDeclaration, share: f64) -> f64 {
        let [low, high] = p.bounds;
        if share < 0.5 {
            (p.neutral + (share - 0.25) * 4.0).clamp(low, high)
        } else {
            low + (share - 0.5) * 2.0 * (high - low)
        }
    }

    fn moving(s: [f64; 6]) -> MotionState {
        MotionState { time: s[0].abs(), x: s[1], y: s[2], vx: s[3], vy: s[4], omega: s[5] }
    }

    #[test]
    fn declarations_are_consistent() {
        for (i, e) in REGISTRY.iter().enumerate() {
            assert!(REGISTRY[..i].iter().all(|other| other.name != e.name), "{} twice", e.name);
            assert!(e.parameters.len() <= MAX_PARAMETERS, "{}", e.name);
            assert!(e.parameters.iter().any(ParameterDeclaration::is_amplitude), "{} cannot vanish", e.name);
            assert!(e.special_cases.iter().all(|h| h.name != e.name && !h.has_special_case(e)), "{}", e.name);
            for p in e.parameters {
                assert!(p.bounds[0] <= p.neutral && p.neutral <= p.bounds[1], "{}.{}", e.name, p.name);
                assert!(e.equation.contains(p.name), "{}: the equation lacks {}", e.name, p.name);
                let (mean, deviation) = p.weak_prior();
                assert!((p.bounds[0]..=p.bounds[1]).contains(&mean), "{}.{}", e.name, p.name);
                assert!(deviation > p.fd_step && p.fd_step > 0.0, "{}.{}", e.name, p.name);
                assert!(p.typical_size <= p.bounds[1] - p.bounds[0], "{}.{}", e.name, p.name);
            }
        }
    }

    /// Every starting value of the search is valid, and its effect is not neutral.
    #[test]
    fn searches_start_where_the_effect_acts() {
        let span = DataRange { area: [-3.0, 0.0, 9.0, 4.0], duration: 2.0, speed: 3.0, interval: 0.05 };
        for e in REGISTRY {
            let SearchStrategy::FromStarts(starts) = e.search else { continue };
            for values in starts(&span) {
                assert_eq!(values.len(), e.parameters.len(), "{}", e.name);
                resolve(&e.term_at_clock(&values, 0.7), "effect").unwrap();
                let acts = e.parameters.iter().zip(&values).any(|(p, v)| p.is_amplitude() && *v != p.neutral);
                assert!(acts, "{}: {values:?}", e.name);
            }
        }
    }

    /// A later start time shifts phases and times, and no other parameter.
    #[test]
    fn later_start_shifts_only_phases_and_times() {
        for e in REGISTRY {
            let values: Vec<f64> = e.parameters.iter().map(|p| p.neutral).collect();
            let shifted = resolve(&e.term_at_clock(&values, 0.25), "effect").unwrap().values;
            for ((p, before), after) in e.parameters.iter().zip(&values).zip(shifted) {
                let turned = match p.role {
                    ParameterRole::Shape(ShapeParameter::Phase) => 2.0 * PI * 0.25,
                    ParameterRole::Shape(ShapeParameter::Time) => -0.25,
                    _ => 0.0,
                };
                assert_eq!(after, before + turned, "{}.{}", e.name, p.name);
            }
        }
    }

    /// A time-dependent law gives the same acceleration at a time in a rollout that starts later.
    #[test]
    fn later_start_keeps_accelerations() {
        let context = SimulationContext { time_step: 1e-3, gravity: [0.0, -9.8] };
        for (e, law) in motions() {
            let values: Vec<f64> = e.parameters.iter().map(|p| value(p, 0.3)).collect();
            let shifted = resolve(&e.term_at_clock(&values, 0.4), "effect").unwrap().values;
            let kick = |values: &[f64], time: f64| {
                let body = MotionState { time, ..moving([0.0, 0.3, 0.2, 1.5, -0.7, 0.1]) };
                law.kick(&law.constants(values, &context), body, context.time_step)
            };
            for (then, now) in kick(&values, 0.9).into_iter().zip(kick(&shifted, 0.5)) {
                assert!((then - now).abs() < 1e-12, "{}: {then} and {now}", e.name);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn lane_kernels_match_scalar_kernels(
            shares in prop::collection::vec(prop::array::uniform8(0.0..1.0f64), LANES),
            states in prop::collection::vec(prop::array::uniform6(-30.0..30.0f64), LANES),
            dt in 1e-4..0.1f64,
        ) {
            let context = SimulationContext { time_step: dt, gravity: [0.3, -9.8] };
            for (effect, law) in motions() {
                let own: Vec<Constants> = shares.iter().map(|s| {
                    let values = effect.parameters.iter().zip(s).map(|(p, s)| value(p, *s));
                    let values: Vec<f64> = values.collect();
                    law.constants(&values, &context)
                }).collect();
                let lanes = std::array::from_fn(|c| std::array::from_fn(|l| own[l][c]));
                let of = |k: usize| std::array::from_fn(|l| states[l][k]);
                let time = of(0).map(f64::abs);
                let mut batch =
                    MotionStateLanes { time, x: of(1), y: of(2), vx: of(3), vy: of(4), omega: of(5) };
                law.kick_lanes(&lanes, &mut batch, dt);
                for l in 0..LANES {
                    let one = law.kick(&own[l], moving(states[l]), dt);
                    let ours = [batch.vx[l], batch.vy[l], batch.omega[l]];
                    prop_assert_eq!(one.map(f64::to_bits), ours.map(f64::to_bits), "{}", effect.name);
                    prop_assert!(one.iter().all(|v| v.is_finite()), "{}: {:?}", effect.name, one);
                    let later = MotionState { time: states[l][0].abs() + 0.37, ..moving(states[l]) };
                    let same = law.kick(&own[l], later, dt).map(f64::to_bits) == one.map(f64::to_bits);
                    prop_assert!(same || !law.is_autonomous(), "{} depends on time", effect.name);
                }
            }
        }

        #[test]
        fn neutral_values_change_nothing(state in prop::array::uniform6(-30.0..30.0f64), dt in 1e-4..0.1f64) {
            let context = SimulationContext { time_step: dt, gravity: [0.3, -9.8] };
            for (effect, law) in motions() {
                let values: Vec<f64> = effect.parameters.iter().map(|p| p.neutral).collect();
                let after = law.kick(&law.constants(&values, &context), moving(state), dt);
                prop_assert_eq!(after.map(f64::to_bits), [state[3], state[4], state[5]].map(f64::to_bits),
                    "{}", effect.name);
                let idle = law.kick(&[0.0; MAX_PARAMETERS], moving([0.0; 6]), dt);
                prop_assert!(idle.iter().all(|v| v.is_finite()), "{}: an empty lane", effect.name);
            }
        }
    }
}
