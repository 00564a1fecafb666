//! Random effects of a model: their design columns and standard deviations.
//!
//! Effects declare the standard deviation of their amplitudes between trials. Every trial has such random
//! accelerations, whatever the model; after a contact those that contacts reset have any plausible value; and
//! all amplitudes of an effect (a wind along x and y) vary between trials in proportion.

use crate::inference::model::{ParameterLayout, Perturbation};
use crate::world::effect::{Effect, REGISTRY};

/// Amount of a random acceleration, in standard deviations, for its finite difference; with a whole one
/// second-order terms would matter.
const PERTURBATION_SHARE: f64 = 0.02;

/// Kind of random effect with a variance component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RandomEffect {
    /// Random acceleration of a trial: index into [`nuisance_accelerations`].
    Acceleration(usize),
    /// Error of an impact.
    ImpactNoise,
    /// Value after a contact has reset it: index into [`RandomDesign::contact_resets`].
    ContactReset(usize),
    /// Common scale of all amplitudes of an effect.
    Scale,
}

/// Design of the random effects in terms of the columns of linearizations.
pub struct RandomDesign {
    pub parameter_count: usize,
    pub acceleration_count: usize,
    /// By acceleration: its index in [`nuisance_accelerations`], and whether contacts reset it.
    pub accelerations: Vec<(usize, bool)>,
    /// Columns (parameters, then accelerations) of effects that contacts reset, with their prior standard
    /// deviations.
    pub contact_resets: Vec<(usize, f64)>,
    /// For every effect, its amplitudes with their derivative by the common scale.
    pub amplitude_directions: Vec<Vec<(usize, f64)>>,
}

impl RandomDesign {
    /// Design for a layout with parameter `values`; `gravity`: of the scene, m/s^2.
    pub fn of(layout: &ParameterLayout, values: &[f64], gravity: f64) -> RandomDesign {
        let pushes = nuisance_accelerations();
        let parameter_count = layout.parameters.len();
        let acceleration = |(k, perturbation): (usize, &Perturbation)| {
            let moved = |p: &usize| perturbation.values[*p] != perturbation.effect.parameters[*p].neutral;
            let p = (0..perturbation.values.len())
                .find(moved)
                .filter(|_| perturbation.effect.reset_by_contact)?;
            let one = (perturbation.values[p] - perturbation.effect.parameters[p].neutral).abs()
                / perturbation.unit;
            Some((parameter_count + k, perturbation.effect.parameters[p].prior_sd / one))
        };
        let accelerations = pushes.iter().map(|p| p.effect.reset_by_contact).enumerate().collect();
        let contact_resets = pushes.iter().enumerate().filter_map(acceleration).collect();
        RandomDesign {
            parameter_count,
            acceleration_count: pushes.len(),
            accelerations,
            contact_resets,
            amplitude_directions: layout.amplitude_directions(values, gravity),
        }
    }
}

/// Random accelerations of every trial: amplitudes of effects that declare a between-trial standard
/// deviation.
pub fn nuisance_accelerations() -> Vec<Perturbation> {
    let of = |effect: &'static Effect| {
        let amplitudes = (0..effect.parameters.len()).filter(|p| effect.parameters[*p].is_amplitude());
        amplitudes.zip(effect.between_trial_sd).map(move |(p, sd)| {
            let value =
                |k: usize| effect.parameters[k].neutral + if k == p { PERTURBATION_SHARE * *sd } else { 0.0 };
            Perturbation {
                effect,
                values: (0..effect.parameters.len()).map(value).collect(),
                unit: PERTURBATION_SHARE,
            }
        })
    };
    REGISTRY.iter().copied().flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_declared_variation_is_a_random_acceleration() {
        let all = nuisance_accelerations();
        let named = |name: &str| all.iter().filter(|p| p.effect.name == name).count();
        assert_eq!((named("lift"), named("wind"), all.len()), (1, 2, 3));
    }
}
