//! The columns of a model beside what it fits: what may differ from launch to launch, and by what reason.
//!
//! Effects declare how far their sizes differ between launches. They are pushes that every launch
//! may have a little of, whatever the model; those that contacts renew are anything plausible after one; and an effect of several amplitudes (a
//! wind along x and along y) may blow harder in one launch than in another, all its amplitudes by the same share.

use super::model::{ParameterLayout, Perturbation};
use crate::world::effect::{Effect, REGISTRY};

/// Share of a push's deviation by which its derivative is taken: of a fall straight down a whole one of lift is a drag, in second
/// order.
const PERTURBATION_SHARE: f64 = 0.02;

/// What has a variance of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RandomEffect {
    /// An acceleration that a launch may have a little of: its place in [`pushes`].
    Acceleration(usize),
    /// An error of what a contact does.
    ImpactNoise,
    /// A size that a contact has changed, as much as is plausible: its place in [`Columns::renewed`].
    ContactReset(usize),
    /// The strength of an effect of several amplitudes as a whole.
    Scale,
}

/// The columns of a model's looks.
pub struct RandomDesign {
    pub parameter_count: usize,
    pub acceleration_count: usize,
    /// By push: its place in [`pushes`], and whether contacts change it.
    pub accelerations: Vec<(usize, bool)>,
    /// Columns (slots or pushes) of effects that contacts renew, and what is plausible of each.
    pub contact_resets: Vec<(usize, f64)>,
    /// Of every effect of several amplitudes, their slots and how far each is from nothing: columns along which its strength
    /// differs as a whole.
    pub amplitude_directions: Vec<Vec<(usize, f64)>>,
}

impl RandomDesign {
    /// Those of a layout whose slots have some values; `gravity`: of the scene, m/s^2.
    pub fn of(layout: &ParameterLayout, values: &[f64], gravity: f64) -> RandomDesign {
        let pushes = nuisance_accelerations();
        let parameter_count = layout.parameters.len();
        let push = |(k, extra): (usize, &Perturbation)| {
            let moved = |p: &usize| extra.values[*p] != extra.effect.parameters[*p].neutral;
            let p = (0..extra.values.len()).find(moved).filter(|_| extra.effect.reset_by_contact)?;
            let one = (extra.values[p] - extra.effect.parameters[p].neutral).abs() / extra.unit;
            Some((parameter_count + k, extra.effect.parameters[p].prior_sd / one))
        };
        let accelerations = pushes.iter().map(|p| p.effect.reset_by_contact).enumerate().collect();
        let contact_resets = pushes.iter().enumerate().filter_map(push).collect();
        RandomDesign {
            parameter_count,
            acceleration_count: pushes.len(),
            accelerations,
            contact_resets,
            amplitude_directions: layout.amplitude_directions(values, gravity),
        }
    }
}

/// Accelerations that every launch may have a little of, of one standard deviation each: the amplitudes of effects that have a
/// reason to differ from launch to launch.
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
    fn every_declared_variation_is_an_acceleration_of_its_own() {
        let all = nuisance_accelerations();
        let named = |name: &str| all.iter().filter(|p| p.effect.name == name).count();
        assert_eq!((named("lift"), named("wind"), all.len()), (1, 2, 3));
    }
}
