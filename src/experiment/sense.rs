//! Ordering constraints: "it bounces better than the floor".
//!
//! Whoever handles an object senses its weight and bounce relative to others long before they could name a number.
//! Such a [`Sense`] bounds a latent from one side; the search never leaves the allowed side.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, within};
use crate::estimate::CemConfig;
use crate::task::Scene;
use crate::world::latent::{FACTORS, factor_index};

/// What is sensed of a latent factor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sense {
    /// `density`, `friction` or `restitution`.
    pub factor: String,
    /// On which side of `than` it is.
    pub relation: Relation,
    /// A value, or the name of a body or static whose own coefficient is known.
    pub than: Than,
}

/// On which side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Relation {
    Above,
    Below,
}

/// What a latent is compared with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Than {
    /// In the factor's unit.
    Value(f64),
    /// Name of a body or static of the scene that does not itself carry the latents.
    Named(String),
}

impl Sense {
    /// `restitution>0.5`, `friction<floor`.
    pub fn parse(text: &str) -> Result<Sense> {
        let refuse = || Error::input("sense", format!("{text:?}"), "factor>value, factor<value, factor>name");
        let at = text.find(['<', '>']).ok_or_else(refuse)?;
        let relation = if text.as_bytes()[at] == b'>' { Relation::Above } else { Relation::Below };
        let (factor, than) = (text[..at].trim(), text[at + 1..].trim());
        if factor.is_empty() || than.is_empty() {
            return Err(refuse());
        }
        let than = than.parse().map_or_else(|_| Than::Named(than.to_string()), Than::Value);
        Ok(Sense { factor: factor.to_string(), relation, than })
    }
}

/// The search with its limits narrowed to what is sensed in all of `scenes`. Applying it again changes nothing.
pub fn apply<'a>(
    senses: &[Sense],
    mut cem: CemConfig,
    scenes: impl Iterator<Item = &'a Scene> + Clone,
) -> Result<CemConfig> {
    for (n, sense) in senses.iter().enumerate() {
        let place = format!("senses[{n}]");
        let of_factor = |_| {
            let known = FACTORS.map(|f| f.name).join(", ");
            Error::input(format!("{place}.factor"), format!("{:?}", sense.factor), format!("one of {known}"))
        };
        let i = factor_index(&sense.factor).map_err(of_factor)?;
        let than = |e: Error| e.under(&place);
        let mut limits = cem.limits.unwrap_or(FACTORS.map(|f| f.bounds));
        let [low, high] = FACTORS[i].bounds;
        let values: Vec<f64> = match &sense.than {
            Than::Value(v) => vec![within("than", *v, low, high).map_err(than)?],
            Than::Named(name) => {
                scenes.clone().map(|s| own(s, name, i)).collect::<Result<_>>().map_err(than)?
            }
        };
        for v in values {
            match sense.relation {
                Relation::Above => limits[i][0] = limits[i][0].max(v),
                Relation::Below => limits[i][1] = limits[i][1].min(v),
            }
        }
        if limits[i][0] >= limits[i][1] {
            let allowed = format!(
                "senses that leave {} room: above {} and below {} leave none",
                FACTORS[i].name, limits[i][0], limits[i][1]
            );
            return Err(Error::input(place, "contradicts what comes before or the bounds", allowed));
        }
        cem.limits = Some(limits);
    }
    Ok(cem)
}

/// The known coefficient (factor number `i`) of what is called `name`.
fn own(scene: &Scene, name: &str, i: usize) -> Result<f64> {
    let known = || {
        let bodies = scene.bodies.iter().filter(|b| i > 0 || b.mass.is_none()).map(|b| &b.name);
        let statics = scene.statics.iter().filter(|_| i > 0).map(|s| &s.name);
        let names: Vec<String> =
            bodies.chain(statics).filter(|n| !scene.carries_latents(n)).map(|n| format!("{n:?}")).collect();
        match names.len() {
            0 => format!("a number; nothing here has a known {}", FACTORS[i].name),
            _ => format!("a number or something whose {} is known: {}", FACTORS[i].name, names.join(", ")),
        }
    };
    let refuse = || Error::input("than", format!("{name:?}"), known());
    if scene.carries_latents(name) {
        return Err(refuse());
    }
    let body = scene
        .body(name)
        .map(|b| [b.density.or(b.mass.is_none().then_some(1.0)), Some(b.friction), Some(b.restitution)]);
    let fixed = scene.statics.iter().find(|s| s.name == name);
    let all = body.or(fixed.map(|s| [None, Some(s.friction), Some(s.restitution)]));
    all.and_then(|values| values[i]).ok_or_else(refuse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::family;

    #[test]
    fn senses_are_read_and_refused_by_name() {
        let basketball = family("basketball").unwrap();
        let scene = &basketball.candidates(0).next().unwrap();
        let of = |text: &[&str]| {
            let senses: Vec<Sense> = text.iter().map(|t| Sense::parse(t)).collect::<Result<_>>()?;
            apply(&senses, CemConfig::fast(basketball.prior), std::iter::once(scene))
        };
        assert_eq!(of(&["restitution>0.5"]).unwrap().limits()[2], [0.5, 1.0]);
        assert_eq!(of(&["friction < floor", "friction>0.1"]).unwrap().limits()[1], [0.1, 0.5]);
        assert_eq!(of(&["mass<2"]).unwrap().limits()[0], [1e-3, 2.0]);
        let twice = apply(
            &[Sense::parse("restitution>0.5").unwrap()],
            of(&["restitution>0.5"]).unwrap(),
            std::iter::once(scene),
        );
        assert_eq!(twice.unwrap(), of(&["restitution>0.5"]).unwrap());
        for (bad, says) in [
            (vec!["grip>1"], "senses[0].factor"),
            (vec!["restitution>2"], "senses[0].than"),
            (vec!["restitution>plank"], "is known"),
            (vec!["restitution>moon"], "\"floor\""),
            (vec!["density>floor"], "a number; nothing"),
            (vec!["restitution"], "sense"),
            (vec!["restitution>0.5", "restitution<0.4"], "senses[1]"),
        ] {
            let error = of(&bad).unwrap_err().to_string();
            assert!(error.contains(says), "{bad:?}: {error}");
        }
    }
}
