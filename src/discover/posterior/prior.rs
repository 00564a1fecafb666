//! What is believed beforehand of every number of a model.

use serde::Serialize;

use crate::discover::model::{Layout, What};
use crate::error::Result;
use crate::estimate::sampler::{Marginal, Prior};
use crate::world::latent::FACTORS;

/// A number of a model, and what is believed of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Known {
    /// `friction`, `linear_drag.c`.
    pub name: String,
    /// SI.
    pub unit: &'static str,
    /// The setting that it is of, where every setting has its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub setting: Option<String>,
    pub prior: Marginal,
}

impl Known {
    /// Name of its column among draws: its own, and behind an @ its setting's.
    pub fn column(&self) -> String {
        self.setting.as_ref().map_or_else(|| self.name.clone(), |s| format!("{}@{s}", self.name))
    }
}

/// Widest bounds that are taken for bounds; beyond, what is plausible decides.
const WIDEST: f64 = 1e6;

/// The numbers of a layout; `names`: of the settings, `latents`: mean and standard deviation of each factor.
pub fn known(layout: &Layout, names: &[String], latents: &[(f64, f64); 3]) -> Vec<Known> {
    let of = |slot: &crate::discover::model::Slot| {
        let [low, high] = slot.bounds.map(|b| b.clamp(-WIDEST, WIDEST));
        let setting = slot.setting.and_then(|s| names.get(s).cloned());
        match slot.what {
            What::Latent(l) => {
                let (mean, sd) = latents[l];
                let prior = Marginal::Normal { mean, sd, low, high };
                Known { name: FACTORS[l].name.into(), unit: FACTORS[l].unit, setting, prior }
            }
            What::Parameter(t, p) => {
                let effect = layout.terms[t].effect;
                let parameter = &effect.parameters[p];
                let prior = match parameter.plausible.is_finite() {
                    true => Marginal::Normal { mean: parameter.neutral, sd: parameter.plausible, low, high },
                    false => Marginal::Uniform { low, high },
                };
                Known {
                    name: format!("{}.{}", effect.name, parameter.name),
                    unit: parameter.unit,
                    setting,
                    prior,
                }
            }
        }
    };
    layout.slots.iter().map(of).collect()
}

/// Their beliefs together.
pub fn of(numbers: &[Known]) -> Result<Prior> {
    Prior::new(numbers.iter().map(|n| n.prior).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::term;
    use crate::world::latent::factor_index;

    #[test]
    fn every_number_has_a_name_and_a_belief() {
        let friction = factor_index("friction").unwrap();
        let layout = Layout::new(&[friction], vec![term("quadratic_drag")], 1);
        let numbers = known(&layout, &[String::new()], &[(1.0, 0.5), (0.8, 0.4), (0.5, 0.25)]);
        let names: Vec<&str> = numbers.iter().map(|n| n.name.as_str()).collect();
        assert_eq!(names, ["friction", "quadratic_drag.k"]);
        assert!(matches!(numbers[0].prior, Marginal::Normal { mean: 0.8, sd: 0.4, .. }));
        assert!(numbers[1].prior.bounds()[0] >= 0.0, "a drag that pushes is none: {:?}", numbers[1].prior);
        assert!(of(&numbers).is_ok());
    }
}
