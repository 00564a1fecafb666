//! Priors of a model's parameters.

use serde::Serialize;

use crate::error::Result;
use crate::estimate::sampler::{JointPrior, Marginal};
use crate::inference::model::{ParameterKind, ParameterLayout};
use crate::world::latent::FACTORS;

/// A parameter of a model with its prior.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterPrior {
    /// For example `friction`, `linear_drag.c`.
    pub name: String,
    /// SI unit.
    pub unit: &'static str,
    /// The setting, for parameters that differ by setting.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub setting: Option<String>,
    pub prior: Marginal,
}

impl ParameterPrior {
    /// Name of the parameter's column: its name, followed by @ and the setting if it has one.
    pub fn column(&self) -> String {
        self.setting.as_ref().map_or_else(|| self.name.clone(), |s| format!("{}@{s}", self.name))
    }
}

/// Maximum magnitude of bounds; beyond, the prior's scale decides.
const MAX_BOUND: f64 = 1e6;

/// Priors of a layout's parameters. `names`: of the settings; `latents`: mean and standard deviation of each
/// factor.
pub fn parameter_priors(
    layout: &ParameterLayout,
    names: &[String],
    latents: &[(f64, f64); 3],
) -> Vec<ParameterPrior> {
    let of = |slot: &crate::inference::model::Parameter| {
        let [low, high] = slot.bounds.map(|b| b.clamp(-MAX_BOUND, MAX_BOUND));
        let setting = slot.setting.and_then(|s| names.get(s).cloned());
        match slot.kind {
            ParameterKind::Latent(l) => {
                let (mean, sd) = latents[l];
                let prior = Marginal::Normal { mean, sd, low, high };
                ParameterPrior { name: FACTORS[l].name.into(), unit: FACTORS[l].unit, setting, prior }
            }
            ParameterKind::EffectParameter(t, p) => {
                let effect = layout.terms[t].effect;
                let parameter = &effect.parameters[p];
                let prior = match parameter.prior_sd.is_finite() {
                    true => Marginal::Normal { mean: parameter.neutral, sd: parameter.prior_sd, low, high },
                    false => Marginal::Uniform { low, high },
                };
                ParameterPrior {
                    name: format!("{}.{}", effect.name, parameter.name),
                    unit: parameter.unit,
                    setting,
                    prior,
                }
            }
        }
    };
    layout.parameters.iter().map(of).collect()
}

/// Their joint prior.
pub fn joint_prior(numbers: &[ParameterPrior]) -> Result<JointPrior> {
    JointPrior::new(numbers.iter().map(|n| n.prior).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::term;
    use crate::world::latent::factor_index;

    #[test]
    fn every_parameter_has_a_name_and_a_prior() {
        let friction = factor_index("friction").unwrap();
        let layout = ParameterLayout::new(&[friction], vec![term("quadratic_drag")], 1);
        let numbers = parameter_priors(&layout, &[String::new()], &[(1.0, 0.5), (0.8, 0.4), (0.5, 0.25)]);
        let names: Vec<&str> = numbers.iter().map(|n| n.name.as_str()).collect();
        assert_eq!(names, ["friction", "quadratic_drag.k"]);
        assert!(matches!(numbers[0].prior, Marginal::Normal { mean: 0.8, sd: 0.4, .. }));
        assert!(numbers[1].prior.bounds()[0] >= 0.0, "drag is not negative: {:?}", numbers[1].prior);
        assert!(joint_prior(&numbers).is_ok());
    }
}
