//! State of a fit: parameter values, nuisances and random effects.

use crate::world::effect::Effect;

/// Parameter values, nuisances and random effects of a model.
#[derive(Clone)]
pub struct FitState {
    /// One value per parameter.
    pub values: Vec<f64>,
    /// Nuisances by segment.
    pub nuisances: Vec<Vec<f64>>,
    /// Conditional modes of the random effects, by segment; empty if there are none.
    pub random_effects: Vec<RandomEffects>,
}

/// Conditional modes of a trial's random effects in a segment.
#[derive(Clone, Default)]
pub struct RandomEffects {
    /// Deviation of the trial's parameters from the common values.
    pub deviations: Vec<f64>,
    /// Random accelerations with their amounts, in their units.
    pub accelerations: Vec<(Perturbation, f64)>,
}

/// An additional term near its neutral values: a direction in the space of accelerations.
#[derive(Clone)]
pub struct Perturbation {
    pub effect: &'static Effect,
    pub values: Vec<f64>,
    /// Amount that the values represent.
    pub unit: f64,
}

impl Perturbation {
    /// Parameter values of an amount of it.
    fn scaled(&self, amount: f64) -> Vec<f64> {
        let own = self.effect.parameters.iter().zip(&self.values);
        own.map(|(p, v)| if p.is_amplitude() { p.neutral + amount / self.unit * (v - p.neutral) } else { *v })
            .collect()
    }
}

impl FitState {
    /// Values and nuisances by segment, without random effects.
    pub fn new(values: Vec<f64>, nuisances: Vec<Vec<f64>>) -> FitState {
        FitState { values, nuisances, random_effects: Vec::new() }
    }

    /// The state of one segment.
    pub fn of_segment(&self, segment: usize) -> FitState {
        let modes = self.random_effects.get(segment).cloned().into_iter().collect();
        FitState {
            random_effects: modes,
            ..FitState::new(self.values.clone(), vec![self.nuisances[segment].clone()])
        }
    }

    /// Parameter values in a segment, random effects included.
    pub fn values_in(&self, segment: usize) -> Vec<f64> {
        let mut values = self.values.clone();
        if let Some(mode) = self.random_effects.get(segment) {
            values.iter_mut().zip(&mode.deviations).for_each(|(v, size)| *v += size);
        }
        values
    }

    /// Random accelerations in a segment as effects.
    pub fn random_effect_terms(&self, segment: usize) -> Vec<(&'static Effect, Vec<f64>)> {
        let accelerations = self.random_effects.get(segment).into_iter().flat_map(|m| &m.accelerations);
        accelerations
            .map(|(acceleration, amount)| (acceleration.effect, acceleration.scaled(*amount)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effect::find;

    /// A random lift of twice 0.1/s and a deviation of the drag.
    #[test]
    fn random_effects_change_values_and_terms() {
        let acceleration = Perturbation { effect: find("lift").unwrap(), values: vec![0.1], unit: 1.0 };
        let mode = RandomEffects { deviations: vec![-0.05], accelerations: vec![(acceleration, 2.0)] };
        let state = FitState {
            random_effects: vec![RandomEffects::default(), mode],
            ..FitState::new(vec![0.3], vec![Vec::new(); 2])
        };
        assert_eq!((state.values_in(0), state.random_effect_terms(0).len()), (vec![0.3], 0));
        assert_eq!(state.values_in(1), [0.25]);
        let beside = state.random_effect_terms(1);
        assert!(beside[0].0.name == "lift" && (beside[0].1[0] - 0.2).abs() < 1e-15, "{}", beside[0].1[0]);
    }
}
