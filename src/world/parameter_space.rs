//! The parameter space of estimates.
//!
//! Its coordinates are the latent factors, in the order of [`FACTORS`], and parameters of effects that are
//! estimated with them, such as `quadratic_drag.k`. The coefficient of linear drag is always the fourth
//! coordinate, 0 if it is not estimated, for compatibility with stored estimates.

use serde::{Deserialize, Serialize};

use super::effect::{Effect, ParameterDeclaration, find, linear_drag};
use super::latent::{FACTORS, Latents};
use crate::error::{Error, Result};
use crate::task::scene::EffectTerm;

/// A point of the space: one value per coordinate, SI. (n_coordinates,)
pub type ParameterVector = Vec<f64>;

/// The coordinates of a [`ParameterVector`].
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterSpace {
    /// Effect parameters after the factors: each parameter, and whether it is estimated.
    parameters: Vec<(EffectParameter, bool)>,
}

/// A parameter of an effect; written `effect.parameter` in files.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct EffectParameter {
    /// The effect in the registry.
    pub effect: &'static Effect,
    /// Index of the parameter.
    pub index: usize,
}

/// The coefficient of linear drag, 1/s; a scene's `damping` is shorthand for it.
pub const LINEAR_DRAG: EffectParameter = EffectParameter { effect: &linear_drag::EFFECT, index: 0 };

impl ParameterSpace {
    /// The space of the factors and the estimated effect parameters.
    pub fn new(fitted: &[EffectParameter]) -> ParameterSpace {
        let others = fitted.iter().filter(|p| **p != LINEAR_DRAG).map(|p| (*p, true));
        ParameterSpace {
            parameters: std::iter::once((LINEAR_DRAG, fitted.contains(&LINEAR_DRAG))).chain(others).collect(),
        }
    }

    /// Number of coordinates.
    #[expect(clippy::len_without_is_empty, reason = "never empty: the factors are always included")]
    pub fn len(&self) -> usize {
        FACTORS.len() + self.parameters.len()
    }

    /// Name of a coordinate: `friction`, `quadratic_drag.k`.
    pub fn name(&self, index: usize) -> String {
        match index.checked_sub(FACTORS.len()) {
            None => FACTORS[index].name.into(),
            Some(p) => self.parameters[p].0.to_string(),
        }
    }

    /// Bounds of a coordinate, inclusive.
    pub fn bounds(&self, index: usize) -> [f64; 2] {
        match index.checked_sub(FACTORS.len()) {
            None => FACTORS[index].bounds,
            Some(p) => self.parameters[p].0.parameter().bounds,
        }
    }

    /// The nearest point within the bounds.
    pub fn clamp(&self, at: &[f64]) -> ParameterVector {
        let within = |(i, v): (usize, &f64)| v.clamp(self.bounds(i)[0], self.bounds(i)[1]);
        at.iter().enumerate().map(within).collect()
    }

    /// The latents at a point.
    pub fn latents(&self, at: &[f64]) -> Latents {
        Latents::of(std::array::from_fn(|i| at[i]))
    }

    /// The effects of a simulation at a point: those in `given`, with estimated values replacing theirs,
    /// followed by the effects that only the point has, unless their values are neutral.
    pub fn effects(&self, at: &[f64], given: &[EffectTerm]) -> Vec<EffectTerm> {
        let mut all = given.to_vec();
        let fitted = self.parameters.iter().zip(&at[FACTORS.len()..]).filter(|((_, fitted), _)| *fitted);
        for ((own, _), value) in fitted {
            EffectTerm::set_in(&mut all, own.effect.name, own.parameter().name, *value);
        }
        let vanishes = |term: &EffectTerm| {
            let own = find(&term.name).map_or(&[][..], |e| e.parameters);
            own.iter().all(|p| term.parameters.get(p.name).is_none_or(|v| *v == p.neutral))
        };
        let added = all.split_off(given.len());
        all.extend(added.into_iter().filter(|term| !vanishes(term)));
        all
    }
}

impl EffectParameter {
    /// The parameter's declaration.
    pub fn parameter(&self) -> &'static ParameterDeclaration {
        &self.effect.parameters[self.index]
    }

    /// Parses `effect.parameter`.
    pub fn parse(text: &str) -> Result<EffectParameter> {
        let (name, parameter) = text.split_once('.').unwrap_or((text, ""));
        let effect = find(name)?;
        let index = effect.parameters.iter().position(|p| p.name == parameter).ok_or_else(|| {
            let known = effect.parameters.iter().map(|p| format!("{name}.{}", p.name));
            Error::not_found("effect parameter", text, known)
        })?;
        Ok(EffectParameter { effect, index })
    }
}

impl std::fmt::Display for EffectParameter {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{}.{}", self.effect.name, self.parameter().name)
    }
}

impl std::fmt::Debug for EffectParameter {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

impl PartialEq for EffectParameter {
    fn eq(&self, other: &EffectParameter) -> bool {
        (self.effect.name, self.index) == (other.effect.name, other.index)
    }
}

impl TryFrom<String> for EffectParameter {
    type Error = Error;

    fn try_from(text: String) -> Result<EffectParameter> {
        EffectParameter::parse(&text)
    }
}

impl From<EffectParameter> for String {
    fn from(parameter: EffectParameter) -> String {
        parameter.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effect::REGISTRY;

    /// Every parameter of every effect can be parsed and used as a coordinate.
    #[test]
    fn every_parameter_is_a_coordinate() {
        for effect in REGISTRY {
            for index in 0..effect.parameters.len() {
                let own = EffectParameter { effect, index };
                assert_eq!(EffectParameter::parse(&own.to_string()).unwrap(), own);
                let all = ParameterSpace::new(&[own]);
                assert_eq!(all.name(all.len() - 1), own.to_string());
                let neutral: Vec<f64> = [1.0, 0.5, 0.5].into_iter().chain([0.0; 1]).collect();
                let at: Vec<f64> = match own == LINEAR_DRAG {
                    true => neutral,
                    false => neutral.into_iter().chain([own.parameter().neutral]).collect(),
                };
                assert_eq!(all.effects(&all.clamp(&at), &[]), [], "{own}: a neutral value is no effect");
            }
        }
        for bad in ["drag", "linear_drag", "linear_drag.k", "ether.c", ""] {
            assert!(EffectParameter::parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn estimated_values_replace_given_ones() {
        let parse = |name: &str| EffectParameter::parse(name).unwrap();
        let all = ParameterSpace::new(&[parse("gust.ax"), parse("wind.ay"), parse("wind.ax")]);
        let names: Vec<String> = (0..all.len()).map(|i| all.name(i)).collect();
        let wanted = ["density", "friction", "restitution", "linear_drag.c", "gust.ax", "wind.ay", "wind.ax"];
        assert_eq!(names, wanted);
        let given = [
            EffectTerm::new("linear_drag", &[("c", 0.1)]),
            EffectTerm::new("gust", &[("ax", 1.0), ("period", 2.0)]),
        ];
        let found = all.effects(&[1.0, 0.5, 0.5, 0.0, 3.0, -1.0, 2.0], &given);
        let gust = EffectTerm::new("gust", &[("ax", 3.0), ("period", 2.0)]);
        // Linear drag is not estimated here, so it keeps its given value.
        assert_eq!(found, [given[0].clone(), gust, EffectTerm::new("wind", &[("ax", 2.0), ("ay", -1.0)])]);
        assert_eq!(ParameterSpace::new(&[]).effects(&[1.0, 0.5, 0.5, 0.0], &given), given);
    }
}
