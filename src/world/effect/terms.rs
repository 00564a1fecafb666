//! Effects by name: the terms of scenes, resolved and validated.

use std::f64::consts::PI;
use std::fmt::Display;

use super::{
    Effect, ParameterDeclaration, ParameterRole, REGISTRY, ShapeParameter, linear_drag as drag,
    restitution_threshold,
};
use crate::error::{Error, Result, check_range};
use crate::task::scene::{EffectTerm, Scene};

/// An effect with its parameter values.
#[derive(Clone)]
pub struct ActiveEffect {
    /// The effect in the registry.
    pub effect: &'static Effect,
    /// One value per parameter, in the order of the declaration.
    pub values: Vec<f64>,
}

impl ActiveEffect {
    /// Whether every parameter has its neutral value.
    pub fn is_neutral(&self) -> bool {
        self.effect.parameters.iter().zip(&self.values).all(|(p, v)| *v == p.neutral)
    }
}

/// Looks up a term and validates its parameters; `place` prefixes the field of an error.
pub fn resolve(term: &EffectTerm, place: impl Display) -> Result<ActiveEffect> {
    let effect = find(&term.name).map_err(|e| e.unknown_in(&format!("{place}.name")))?;
    for given in term.parameters.keys() {
        if !effect.parameters.iter().any(|p| p.name == given) {
            let known = effect.parameters.iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
            let field = format!("{place}.parameters.{given}");
            return Err(Error::input(field, "unknown", format!("parameters of {}: {known}", effect.name)));
        }
    }
    let value = |p: &ParameterDeclaration| {
        let v = term.parameters.get(p.name).copied().unwrap_or(p.neutral);
        let [low, high] = p.bounds;
        // Field names are formatted only for errors: this runs for every rollout.
        if (low..=high).contains(&v) {
            return Ok(v);
        }
        check_range(&format!("{place}.parameters.{}", p.name), v, low, high)
    };
    Ok(ActiveEffect { effect, values: effect.parameters.iter().map(value).collect::<Result<_>>()? })
}

/// The effects of a scene in order of application: its damping, the threshold of its contact rules, its
/// effects.
pub fn scene_effects(scene: &Scene) -> Result<Vec<ActiveEffect>> {
    let mut all = Vec::new();
    if let Some(kept) = scene.damping.filter(|kept| *kept < 1.0) {
        all.push(resolve(&damping(kept), "damping")?);
    }
    if let Some(rules) = scene.contact_rules.filter(|rules| rules.restitution_threshold > 0.0) {
        let term = restitution_threshold::EFFECT.term_at_clock(&[rules.restitution_threshold], 0.0);
        all.push(resolve(&term, "contact_rules")?);
    }
    for (i, term) in scene.effects.iter().enumerate() {
        all.push(resolve(term, format_args!("effects[{i}]"))?);
    }
    Ok(all)
}

/// Errors unless the effects of a scene are valid; the field is relative to the scene.
pub fn validate_terms(terms: &[EffectTerm]) -> Result<()> {
    terms.iter().enumerate().try_for_each(|(i, term)| resolve(term, format_args!("effects[{i}]")).map(|_| ()))
}

/// Maximum number of effects in a set.
const MAX_EFFECTS_PER_SET: usize = 4;

/// Errors unless the names are distinct effects, few enough for one set; `field` is the set's field.
pub fn validate_set(field: &str, names: &[String]) -> Result<()> {
    if names.len() > MAX_EFFECTS_PER_SET {
        let allowed = format!("at most {MAX_EFFECTS_PER_SET}");
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

/// The effect named `name`; an alias is an error that says the name.
pub fn find(name: &str) -> Result<&'static Effect> {
    REGISTRY.iter().copied().find(|e| e.name == name).ok_or_else(|| {
        let meant: Vec<&str> = find_alias(name).map(|e| e.name).into_iter().collect();
        let all = || REGISTRY.iter().map(|e| e.name).collect();
        Error::not_found("effect", name, if meant.is_empty() { all() } else { meant })
    })
}

/// The effect that is also called `name`.
pub fn find_alias(name: &str) -> Option<&'static Effect> {
    REGISTRY.iter().copied().find(|e| e.aliases.contains(&name))
}

/// The effect for a fraction of velocity kept per second (Pymunk's damping).
pub fn damping(kept: f64) -> EffectTerm {
    linear_drag(-kept.ln())
}

/// Linear drag with coefficient `c`, 1/s.
pub fn linear_drag(c: f64) -> EffectTerm {
    drag::EFFECT.term_at_clock(&[c], 0.0)
}

impl Effect {
    /// The effect with these values, one per parameter, for a rollout that starts at time `clock` (s) of
    /// the clock that the values refer to.
    pub fn term_at_clock(&self, values: &[f64], clock: f64) -> EffectTerm {
        let mut values = values.to_vec();
        let of = |shape| self.parameters.iter().position(|p| p.role == ParameterRole::Shape(shape));
        if let (true, Some(period), Some(phase)) =
            (clock != 0.0, of(ShapeParameter::Period), of(ShapeParameter::Phase))
        {
            values[phase] = (values[phase] + 2.0 * PI * clock / values[period]).rem_euclid(2.0 * PI);
        }
        if let Some(time) = of(ShapeParameter::Time) {
            values[time] -= clock;
        }
        let parameters = self.parameters.iter().zip(values).map(|(p, v)| (p.name.to_string(), v)).collect();
        EffectTerm { name: self.name.to_string(), parameters }
    }
}
