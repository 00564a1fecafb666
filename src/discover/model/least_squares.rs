//! Fits of a layout to all windows by damped Gauss-Newton steps.
//!
//! What is left of the windows' residuals and columns once their starts are projected out is summed by trial: a Gram matrix of
//! the columns, their products with the residual, and the residual's square. Fits and held-out squares need nothing else.
//!
//! Source: Levenberg (1944) for the damping, which grows when a step fails.

use nalgebra::{DMatrix, DVector};

use super::data::Data;
use super::layout::Layout;
use super::look::{Correction, Look, looks};
use super::state::State;
use crate::discover::stats::{hold, solve};
use crate::error::Result;

/// Steps at the beginning of a fit that leave the shapes of effects alone: while an effect is weak its shape is told by
/// nothing, and a step in it would be wild.
const HELD: usize = 2;
/// Most that a step may move a nuisance.
const FARTHEST: f64 = 50.0;
/// Damping: at first, least, where a step has failed, and from where on there is no way down. By what it changes after a step
/// that succeeds and one that fails.
const DAMPING: f64 = 1e-4;
const LEAST: f64 = 1e-8;
const FAILED: f64 = 1e-3;
const HOPELESS: f64 = 1e5;
const EASED: f64 = 0.1;
const TIGHTENED: f64 = 30.0;
/// Share of the sum of squares (at most so much a trial), by less than which a fit that has settled still changes it.
const SETTLED: f64 = 1e-4;
const BY_TRIAL: f64 = 50.0;

/// What one pass over all windows gives.
pub struct Pass {
    /// By trial.
    pub trials: Vec<Sums>,
    /// By window: residuals (m), two to a point, nuisances projected out.
    pub residuals: Vec<Vec<f64>>,
    /// By window: squares of the projected residual in units of the noise.
    pub squares: Vec<f64>,
    /// By window.
    corrections: Vec<Correction>,
}

/// Sums over the windows of one trial, in units of the noise.
#[derive(Clone)]
pub struct Sums {
    pub gram: DMatrix<f64>,
    pub score: DVector<f64>,
    pub square: f64,
}

impl Sums {
    /// The square with the slots `step` away.
    pub fn after(&self, step: &DVector<f64>) -> f64 {
        self.square - 2.0 * self.score.dot(step) + (step.transpose() * &self.gram * step)[(0, 0)]
    }
}

/// Fits a layout from a state in so many steps at most, and some more where effects have shapes; launches are alike.
pub fn fit(data: &Data, layout: &Layout, start: State, most: usize) -> Result<(State, Pass)> {
    let mut state = State { modes: Vec::new(), ..start };
    let mut here = pass(data, layout, &state)?;
    let mut damping = DAMPING;
    let shaped = (0..layout.slots.len()).any(|i| layout.shapes(i));
    let held = if shaped { HELD } else { 0 };
    for round in 0..most + held {
        let step = step(layout, &state.values, &here, damping, round < held);
        let tried = moved(layout, &state, &step, &here.corrections);
        let there = pass(data, layout, &tried)?;
        let (old, new) = (cost(layout, &state, &here), cost(layout, &tried, &there));
        if new <= old * (1.0 + 1e-9) {
            (state, here) = (tried, there);
            damping = (damping * EASED).max(LEAST);
            if round >= held && old - new < SETTLED * old.min(BY_TRIAL * data.trials as f64) + 1e-6 {
                break;
            }
        } else {
            damping = (damping * TIGHTENED).max(FAILED);
            if damping > HOPELESS {
                break;
            }
        }
    }
    Ok((state, here))
}

/// Residuals, derivatives and sums at a state whose launches are alike.
fn pass(data: &Data, layout: &Layout, state: &State) -> Result<Pass> {
    Ok(summed(data, looks(data, layout, state, &[])?, layout.slots.len()))
}

/// What windows show, summed up by trial; their first columns are those of `q` slots.
pub fn summed(data: &Data, looks: Vec<Look>, q: usize) -> Pass {
    let empty = || Sums { gram: DMatrix::zeros(q, q), score: DVector::zeros(q), square: 0.0 };
    let mut out = Pass {
        trials: (0..data.trials).map(|_| empty()).collect(),
        residuals: Vec::new(),
        squares: Vec::new(),
        corrections: Vec::new(),
    };
    for (window, look) in data.windows.iter().zip(looks) {
        let sums = &mut out.trials[window.trial];
        let columns = look.columns.columns(0, q);
        sums.gram += columns.tr_mul(&columns);
        sums.score += columns.tr_mul(&look.residual);
        sums.square += look.square;
        out.squares.push(look.square);
        out.residuals.push((0..2 * window.points.len()).map(|i| look.metres(i)).collect());
        out.corrections.push(look.correction);
    }
    out
}

/// Sum of squares of all trials.
pub fn total(pass: &Pass) -> f64 {
    pass.trials.iter().map(|t| t.square).sum()
}

/// What a fit makes small: the sum of squares, and what values cost that are believed to be about nothing.
fn cost(layout: &Layout, state: &State, pass: &Pass) -> f64 {
    total(pass) + layout.slots.iter().zip(&state.values).map(|(s, v)| s.belief * v * v).sum::<f64>()
}

/// A state after a step, as far as bounds allow it, every window's start with it.
fn moved(layout: &Layout, state: &State, step: &DVector<f64>, corrections: &[Correction]) -> State {
    let mut out = state.clone();
    let mut taken = DVector::zeros(step.len());
    for (i, slot) in layout.slots.iter().enumerate() {
        out.values[i] = (state.values[i] + step[i]).clamp(slot.bounds[0], slot.bounds[1]);
        taken[i] = out.values[i] - state.values[i];
    }
    for (nuisances, correction) in out.nuisances.iter_mut().zip(corrections) {
        let moved = correction.step(&taken);
        nuisances.iter_mut().zip(moved.iter()).for_each(|(n, m)| *n += m.clamp(-FARTHEST, FARTHEST));
    }
    out
}

fn step(layout: &Layout, values: &[f64], pass: &Pass, damping: f64, hold_shapes: bool) -> DVector<f64> {
    let q = layout.slots.len();
    let (mut gram, mut score) = (DMatrix::zeros(q, q), DVector::zeros(q));
    for t in &pass.trials {
        gram += &t.gram;
        score += &t.score;
    }
    for (i, slot) in layout.slots.iter().enumerate() {
        gram[(i, i)] += slot.belief;
        score[i] -= slot.belief * values[i];
    }
    // A value at its bound that is pushed outwards stays there, and the others step without it.
    for (i, slot) in layout.slots.iter().enumerate() {
        if slot.is_stuck(values[i], score[i]) || (hold_shapes && layout.shapes(i)) {
            hold(&mut gram, &mut score, i);
        }
    }
    for i in 0..q {
        gram[(i, i)] = gram[(i, i)] * (1.0 + damping) + layout.slots[i].ridge();
    }
    solve(&gram, &score)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{flights, term};
    use crate::world::Engine;

    fn fitted(wind: [f64; 2], names: &[&str], bounds: Option<[f64; 2]>) -> (State, Pass) {
        let (mut windows, settings) = flights(wind, 4);
        // Guesses of starts are off.
        windows.iter_mut().for_each(|w| w.nuisances[2] += 0.5);
        let data = Data::new(&windows, &settings, vec![1e-3; 4], Engine::Auto);
        let mut layout = Layout::new(&[], names.iter().map(|n| term(n)).collect(), 1);
        layout.slots[0].bounds = bounds.unwrap_or(layout.slots[0].bounds);
        let nuisances = windows.iter().map(|w| w.nuisances.clone()).collect();
        fit(&data, &layout, State::new(layout.start(&[0.0; 3]), nuisances), 8).unwrap()
    }

    fn most(pass: &Pass) -> f64 {
        pass.residuals.iter().flatten().fold(0.0, |most, r| r.abs().max(most))
    }

    /// A wind is found with every start, and nothing of what was seen is left.
    #[test]
    fn a_wind_is_found_with_every_start() {
        let (State { values, nuisances, .. }, pass) = fitted([0.8, -0.3], &["wind"], None);
        assert!((values[0] - 0.8).abs() < 1e-5 && (values[1] + 0.3).abs() < 1e-5, "{values:?}");
        assert!(nuisances.iter().all(|n| (n[2] - 3.0).abs() < 1e-5), "{nuisances:?}");
        assert!(most(&pass) < 1e-6, "{}", most(&pass));
    }

    /// Believed to be about nothing as firmly as the launches tell it, a wind is half of what they say.
    #[test]
    fn a_belief_pulls_towards_nothing() {
        let (windows, settings) = flights([0.8, -0.3], 4);
        let data = Data::new(&windows, &settings, vec![1e-3; 4], Engine::Auto);
        let mut layout = Layout::new(&[], vec![term("wind")], 1);
        let start = State::new(vec![0.0; 2], windows.iter().map(|w| w.nuisances.clone()).collect());
        let told = pass(&data, &layout, &start).unwrap().trials.iter().map(|t| t.gram[(0, 0)]).sum::<f64>();
        layout.slots[0].belief = told;
        let (state, _) = fit(&data, &layout, start, 8).unwrap();
        assert!((state.values[0] - 0.4).abs() < 1e-3, "{:?}", state.values);
        assert!((state.values[1] + 0.3).abs() < 1e-3, "{:?}", state.values);
    }

    /// Where a wind stands at its bound, a drag makes up for it as far as it can, as if the wind were known.
    #[test]
    fn a_value_at_its_bound_does_not_hold_the_others() {
        let (state, _) = fitted([-0.8, 0.0], &["wind", "linear_drag"], Some([-0.5, 0.5]));
        assert_eq!(state.values[0], -0.5);
        assert!(state.values[2] > 0.05, "{:?}", state.values);
    }
}
