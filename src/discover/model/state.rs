//! Where a fit stands: values, starts of windows, and how each launch is unlike the others.

use crate::world::effect::Effect;

/// Where a fit stands.
#[derive(Clone)]
pub struct FitState {
    /// One value a slot.
    pub values: Vec<f64>,
    /// Nuisances by window.
    pub nuisances: Vec<Vec<f64>>,
    /// How launches are unlike each other, by window; empty where all are taken to be as the values say.
    pub random_effects: Vec<RandomEffects>,
}

/// How a launch is unlike the others in a window: what is most likely of all that differs from launch to launch.
#[derive(Clone, Default)]
pub struct RandomEffects {
    /// How far its sizes are from the values, by slot.
    pub deviations: Vec<f64>,
    /// Pushes of its own, and how much there is of each, in its unit.
    pub accelerations: Vec<(Perturbation, f64)>,
}

/// A term to be added to a model, at values near which it vanishes: the direction that it would move paths in.
#[derive(Clone)]
pub struct Perturbation {
    pub effect: &'static Effect,
    pub values: Vec<f64>,
    /// By what the difference that it makes is divided.
    pub unit: f64,
}

impl Perturbation {
    /// The values of so much of it.
    fn scaled(&self, amount: f64) -> Vec<f64> {
        let own = self.effect.parameters.iter().zip(&self.values);
        own.map(|(p, v)| if p.is_amplitude() { p.neutral + amount / self.unit * (v - p.neutral) } else { *v })
            .collect()
    }
}

impl FitState {
    /// Values, and nuisances by window; all launches alike.
    pub fn new(values: Vec<f64>, nuisances: Vec<Vec<f64>>) -> FitState {
        FitState { values, nuisances, random_effects: Vec::new() }
    }

    /// The state of a window alone.
    pub fn of_segment(&self, window: usize) -> FitState {
        let modes = self.random_effects.get(window).cloned().into_iter().collect();
        FitState {
            random_effects: modes,
            ..FitState::new(self.values.clone(), vec![self.nuisances[window].clone()])
        }
    }

    /// The values that hold in a window.
    pub fn values_in(&self, window: usize) -> Vec<f64> {
        let mut values = self.values.clone();
        if let Some(mode) = self.random_effects.get(window) {
            values.iter_mut().zip(&mode.deviations).for_each(|(v, size)| *v += size);
        }
        values
    }

    /// What acts in a window beside the model's own terms.
    pub fn random_effect_terms(&self, window: usize) -> Vec<(&'static Effect, Vec<f64>)> {
        let pushes = self.random_effects.get(window).into_iter().flat_map(|m| &m.accelerations);
        pushes.map(|(push, amount)| (push.effect, push.scaled(*amount))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effect::find;

    /// Twice a lift of 0.1 per s beside a model that has a drag, which this launch has less of.
    #[test]
    fn a_launch_is_as_its_mode_says() {
        let push = Perturbation { effect: find("lift").unwrap(), values: vec![0.1], unit: 1.0 };
        let mode = RandomEffects { deviations: vec![-0.05], accelerations: vec![(push, 2.0)] };
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
