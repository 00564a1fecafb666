//! Latent factors and effects.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::json_object::JsonObject;
use crate::error::{Error, Result};
use crate::task::scene::EffectTerm;
use crate::world::{Latents, effect};

/// Latent factors; all are optional.
#[derive(Clone, Copy, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LatentsIn {
    /// kg/m^2
    pub density: Option<f64>,
    /// Alias of `density`.
    pub mass: Option<f64>,
    /// Surface coefficient.
    pub friction: Option<f64>,
    /// Surface coefficient.
    pub restitution: Option<f64>,
}

/// An effect with its parameters.
#[derive(Clone, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EffectIn {
    /// `linear_drag`, ...; `iplw effects` lists all.
    pub name: String,
    /// Values in the effect's units; absent ones have their neutral value.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

/// Active latent factors; absent where bodies have the scene's own values.
#[derive(Serialize, ToSchema)]
pub struct LatentsOut {
    /// kg/m^2
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
}

impl LatentsIn {
    /// Validates the latents; errors name the user's field after `prefix`.
    pub fn checked(self, prefix: &str) -> Result<Latents> {
        latents(self, prefix)
    }
}

fn latents(given: LatentsIn, prefix: &str) -> Result<Latents> {
    if let (Some(mass), Some(_)) = (given.mass, given.density) {
        return Err(Error::input(
            format!("{prefix}mass"),
            mass,
            "only one of mass and density, which are the same factor",
        ));
    }
    let latents = Latents {
        density: given.density.or(given.mass),
        friction: given.friction,
        restitution: given.restitution,
    };
    latents.validate().map_err(|e| match e {
        Error::Input(mut input) => {
            let name = input.field.strip_prefix("latents.").unwrap_or(&input.field);
            let name = if name == "density" && given.mass.is_some() { "mass" } else { name };
            input.field = format!("{prefix}{name}");
            Error::Input(input)
        }
        other => other,
    })?;
    Ok(latents)
}

/// Combines damping and effects; `None` if neither was given. Errors name the field after `prefix`.
pub fn effects(
    damping: Option<f64>,
    given: Option<Vec<JsonObject<EffectIn>>>,
    prefix: &str,
) -> Result<Option<Vec<EffectTerm>>> {
    if damping.is_none() && given.is_none() {
        return Ok(None);
    }
    let mut terms = Vec::new();
    if let Some(kept) = damping {
        if !(kept > 0.0 && kept <= 1.0) {
            let allowed = "a fraction of velocity kept per second, in (0, 1]";
            return Err(Error::input(format!("{prefix}damping"), kept, allowed));
        }
        if kept < 1.0 {
            let term = effect::damping(kept);
            effect::resolve(&term, "").map_err(|_| {
                Error::input(format!("{prefix}damping"), kept, "a larger fraction: this one stops all motion")
            })?;
            terms.push(term);
        }
    }
    for (i, JsonObject(e)) in given.into_iter().flatten().enumerate() {
        let term = EffectTerm { name: e.name, parameters: e.parameters };
        effect::resolve(&term, format_args!("{prefix}effects[{i}]"))?;
        terms.push(term);
    }
    if terms.len() > MAX_EFFECTS {
        let value = format!("{} effects", terms.len());
        return Err(Error::input(
            format!("{prefix}effects"),
            value,
            format!("at most {MAX_EFFECTS} effects"),
        ));
    }
    Ok(Some(terms))
}

/// Maximum number of effects of a world.
const MAX_EFFECTS: usize = 32;

impl From<Latents> for LatentsOut {
    fn from(l: Latents) -> LatentsOut {
        LatentsOut { density: l.density, friction: l.friction, restitution: l.restitution }
    }
}

impl From<EffectTerm> for EffectIn {
    fn from(term: EffectTerm) -> EffectIn {
        EffectIn { name: term.name, parameters: term.parameters }
    }
}
