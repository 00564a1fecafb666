//! Order constraints on latents, for example "it bounces better than the floor".
//!
//! People who handle an object can compare its weight and bounce with others without knowing a number. An
//! [`OrderConstraint`] bounds a latent from one side, and the search stays within the bound.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, check_range};
use crate::estimate::CemConfig;
use crate::task::Scene;
use crate::world::latent::{FACTORS, factor_index};

/// One-sided bound on a latent factor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrderConstraint {
    /// `density`, `friction` or `restitution`.
    pub factor: String,
    /// Side of `than` on which the factor lies.
    pub relation: OrderRelation,
    /// A value, or the name of a body or static with a known coefficient.
    pub than: ReferenceValue,
}

/// Side of the reference value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OrderRelation {
    Above,
    Below,
}

/// Reference value of an order constraint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum ReferenceValue {
    /// Value in the factor's unit.
    Value(f64),
    /// Name of a body or static of the scene whose coefficients are not latent.
    Named(String),
}

impl OrderConstraint {
    /// Parses a constraint such as `restitution>0.5` or `friction<floor`.
    pub fn parse(text: &str) -> Result<OrderConstraint> {
        let refuse = || Error::input("sense", format!("{text:?}"), "factor>value, factor<value, factor>name");
        let at = text.find(['<', '>']).ok_or_else(refuse)?;
        let relation = if text.as_bytes()[at] == b'>' { OrderRelation::Above } else { OrderRelation::Below };
        let (factor, than) = (text[..at].trim(), text[at + 1..].trim());
        if factor.is_empty() || than.is_empty() {
            return Err(refuse());
        }
        let than =
            than.parse().map_or_else(|_| ReferenceValue::Named(than.to_string()), ReferenceValue::Value);
        Ok(OrderConstraint { factor: factor.to_string(), relation, than })
    }
}

/// The search configuration with its limits narrowed by the constraints in all `scenes`. Idempotent.
pub fn apply_constraints<'a>(
    senses: &[OrderConstraint],
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
        let than = |e: Error| e.in_field(&place);
        let mut limits = cem.limits.unwrap_or(FACTORS.map(|f| f.bounds));
        let [low, high] = FACTORS[i].bounds;
        let values: Vec<f64> = match &sense.than {
            ReferenceValue::Value(v) => vec![check_range("than", *v, low, high).map_err(than)?],
            ReferenceValue::Named(name) => scenes
                .clone()
                .map(|s| reference_coefficient(s, name, i))
                .collect::<Result<_>>()
                .map_err(than)?,
        };
        for v in values {
            match sense.relation {
                OrderRelation::Above => limits[i][0] = limits[i][0].max(v),
                OrderRelation::Below => limits[i][1] = limits[i][1].min(v),
            }
        }
        if limits[i][0] >= limits[i][1] {
            let allowed = format!(
                "constraints with a non-empty interval for {}: above {} and below {} exclude every value",
                FACTORS[i].name, limits[i][0], limits[i][1]
            );
            return Err(Error::input(place, "contradicts the earlier constraints or the bounds", allowed));
        }
        cem.limits = Some(limits);
    }
    Ok(cem)
}

/// Known coefficient (factor index `i`) of the body or static called `name`.
fn reference_coefficient(scene: &Scene, name: &str, i: usize) -> Result<f64> {
    let known = || {
        let bodies = scene.bodies.iter().filter(|b| i > 0 || b.mass.is_none()).map(|b| &b.name);
        let statics = scene.statics.iter().filter(|_| i > 0).map(|s| &s.name);
        let names: Vec<String> =
            bodies.chain(statics).filter(|n| !scene.carries_latents(n)).map(|n| format!("{n:?}")).collect();
        match names.len() {
            0 => format!("a number; nothing in the scene has a known {}", FACTORS[i].name),
            _ => format!(
                "a number, or a body or static whose {} is known: {}",
                FACTORS[i].name,
                names.join(", ")
            ),
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
    fn parses_constraints_and_rejects_invalid_ones() {
        let basketball = family("basketball").unwrap();
        let scene = &basketball.candidates(0).next().unwrap();
        let of = |text: &[&str]| {
            let senses: Vec<OrderConstraint> =
                text.iter().map(|t| OrderConstraint::parse(t)).collect::<Result<_>>()?;
            apply_constraints(&senses, CemConfig::fast(basketball.prior), std::iter::once(scene))
        };
        assert_eq!(of(&["restitution>0.5"]).unwrap().limits()[2], [0.5, 1.0]);
        assert_eq!(of(&["friction < floor", "friction>0.1"]).unwrap().limits()[1], [0.1, 0.5]);
        assert_eq!(of(&["mass<2"]).unwrap().limits()[0], [1e-3, 2.0]);
        let twice = apply_constraints(
            &[OrderConstraint::parse("restitution>0.5").unwrap()],
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
