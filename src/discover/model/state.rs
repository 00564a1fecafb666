//! Where a fit stands: values, starts of windows, and how each launch is unlike the others.

use crate::world::effect::Effect;

/// Where a fit stands.
#[derive(Clone)]
pub struct State {
    /// One value a slot.
    pub values: Vec<f64>,
    /// Nuisances by window.
    pub nuisances: Vec<Vec<f64>>,
    /// How launches are unlike each other, by window; empty where all are taken to be as the values say.
    pub modes: Vec<Mode>,
}

/// How a launch is unlike the others in a window: what is most likely of all that differs from launch to launch.
#[derive(Clone, Default)]
pub struct Mode {
    /// How far its sizes are from the values, by slot.
    pub sizes: Vec<f64>,
    /// Pushes of its own, and how much there is of each, in its unit.
    pub pushes: Vec<(Extra, f64)>,
}

/// A term to be added to a model, at values near which it vanishes: the direction that it would move paths in.
#[derive(Clone)]
pub struct Extra {
    pub effect: &'static Effect,
    pub values: Vec<f64>,
    /// By what the difference that it makes is divided.
    pub unit: f64,
}

impl Extra {
    /// The values of so much of it.
    fn times(&self, amount: f64) -> Vec<f64> {
        let own = self.effect.parameters.iter().zip(&self.values);
        own.map(|(p, v)| if p.is_amplitude() { p.neutral + amount / self.unit * (v - p.neutral) } else { *v })
            .collect()
    }
}

impl State {
    /// Values, and nuisances by window; all launches alike.
    pub fn new(values: Vec<f64>, nuisances: Vec<Vec<f64>>) -> State {
        State { values, nuisances, modes: Vec::new() }
    }

    /// The state of a window alone.
    pub fn of(&self, window: usize) -> State {
        let modes = self.modes.get(window).cloned().into_iter().collect();
        State { modes, ..State::new(self.values.clone(), vec![self.nuisances[window].clone()]) }
    }

    /// The values that hold in a window.
    pub fn values_in(&self, window: usize) -> Vec<f64> {
        let mut values = self.values.clone();
        if let Some(mode) = self.modes.get(window) {
            values.iter_mut().zip(&mode.sizes).for_each(|(v, size)| *v += size);
        }
        values
    }

    /// What acts in a window beside the model's own terms.
    pub fn beside(&self, window: usize) -> Vec<(&'static Effect, Vec<f64>)> {
        let pushes = self.modes.get(window).into_iter().flat_map(|m| &m.pushes);
        pushes.map(|(push, amount)| (push.effect, push.times(*amount))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effect::find;

    /// Twice a lift of 0.1 per s beside a model that has a drag, which this launch has less of.
    #[test]
    fn a_launch_is_as_its_mode_says() {
        let push = Extra { effect: find("lift").unwrap(), values: vec![0.1], unit: 1.0 };
        let mode = Mode { sizes: vec![-0.05], pushes: vec![(push, 2.0)] };
        let state =
            State { modes: vec![Mode::default(), mode], ..State::new(vec![0.3], vec![Vec::new(); 2]) };
        assert_eq!((state.values_in(0), state.beside(0).len()), (vec![0.3], 0));
        assert_eq!(state.values_in(1), [0.25]);
        let beside = state.beside(1);
        assert!(beside[0].0.name == "lift" && (beside[0].1[0] - 0.2).abs() < 1e-15, "{}", beside[0].1[0]);
    }
}
