//! Latent factors and effects in requests, and their notation on the command line: `density=1.2,friction=0.5` and
//! `linear_drag:c=0.223`.

use std::collections::BTreeMap;
use std::fmt::Arguments;

use serde::Deserialize;
use utoipa::ToSchema;

use crate::error::{Error, Result};
use crate::json::JsonObject;
use crate::task::scene::EffectTerm;
use crate::world::{Engine, Latents, effect};

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

impl LatentsIn {
    /// Validates the latents; errors name the user's field after `prefix`.
    pub fn checked(self, prefix: &str) -> Result<Latents> {
        let LatentsIn { density, mass, friction, restitution } = self;
        if let (Some(mass), Some(_)) = (mass, density) {
            let allowed = "only one of mass and density, which are the same factor";
            return Err(Error::input(format!("{prefix}mass"), mass, allowed));
        }
        let latents = Latents { density: density.or(mass), friction, restitution };
        latents.validate().map_err(|e| {
            e.map_input(|input| {
                let name = input.field.strip_prefix("latents.").unwrap_or(&input.field);
                let name = if name == "density" && mass.is_some() { "mass" } else { name };
                input.field = format!("{prefix}{name}");
            })
        })?;
        Ok(latents)
    }
}

/// Combines damping and effects; `None` if neither was given. Errors name the field after `prefix`.
pub fn effects(
    damping: Option<f64>,
    given: Option<Vec<JsonObject<EffectTerm>>>,
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
    for (i, JsonObject(term)) in given.into_iter().flatten().enumerate() {
        check_term(&term, format_args!("{prefix}effects[{i}]"))?;
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

/// The engine by name. Default: `auto`.
pub fn engine(name: Option<&str>) -> Result<Engine> {
    name.map_or(Ok(Engine::Auto), Engine::from_name).map_err(|e| e.unknown_in("engine"))
}

/// `name:parameter=value,...` as an effect.
pub fn parse_effect(text: &str) -> Result<JsonObject<EffectTerm>> {
    let (name, rest) = text.split_once(':').unwrap_or((text, ""));
    let parameters = parse_pairs("--effect", rest)?
        .into_iter()
        .map(|(k, v)| Ok((k.clone(), parse_number(&format!("--effect {name}:{k}"), &v)?)))
        .collect::<Result<BTreeMap<_, _>>>()?;
    let term = EffectTerm { name: name.to_string(), parameters };
    check_term(&term, format_args!("--effect"))?;
    Ok(JsonObject(term))
}

/// Errors unless an effect exists, its parameters are within bounds, and at least one has a value.
fn check_term(term: &EffectTerm, place: Arguments) -> Result<()> {
    let effect = effect::resolve(term, place)?.effect;
    if !term.parameters.is_empty() {
        return Ok(());
    }
    let names: Vec<String> = effect.parameters.iter().map(|p| format!("{} ({})", p.name, p.unit)).collect();
    let allowed = format!("a value for at least one of its parameters: {}", names.join(", "));
    Err(Error::input(format!("{place}.parameters"), format!("none for {}", effect.name), allowed))
}

/// `density=..,friction=..,restitution=..`, validated; missing latents are left to the scene.
pub fn parse_latents(text: &str) -> Result<JsonObject<LatentsIn>> {
    let mut latents = LatentsIn::default();
    for (key, value) in parse_pairs("--latents", text)? {
        let v = Some(parse_number(&format!("--latents {key}"), &value)?);
        match key.as_str() {
            "density" | "mass" => latents.density = v,
            "friction" => latents.friction = v,
            "restitution" => latents.restitution = v,
            _ => return Err(Error::input("--latents", format!("{key:?}"), "density, friction, restitution")),
        }
    }
    latents.checked("latents.")?;
    Ok(JsonObject(latents))
}

/// `name=value,...`; errors name `option`.
pub fn parse_pairs(option: &str, text: &str) -> Result<Vec<(String, String)>> {
    text.split(',')
        .map(str::trim)
        .filter(|part| !part.is_empty())
        .map(|part| match part.split_once('=') {
            Some((k, v)) => Ok((k.trim().to_string(), v.trim().to_string())),
            None => Err(Error::input(option, format!("{part:?}"), "name=value, separated by commas")),
        })
        .collect()
}

/// A finite number; errors name `field`.
pub fn parse_number(field: &str, text: &str) -> Result<f64> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err(Error::input(field, format!("{text:?}"), "a finite number")),
    }
}
