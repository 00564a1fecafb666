//! Fits of a layout to all windows by damped Gauss-Newton steps.
//!
//! What is left of the windows' residuals and columns once their starts are projected out is summed by trial: a Gram matrix of
//! the columns, their products with the residual, and the residual's square. Fits and held-out squares need nothing else.
//!
//! Source: Levenberg (1944) for the damping, which grows when a step fails.

use nalgebra::{DMatrix, DVector};

use super::data::SegmentData;
use super::layout::ParameterLayout;
use super::look::{Linearization, NuisanceUpdate, linearise};
use super::state::FitState;
use crate::discover::stats::{fix_parameter, solve};
use crate::error::Result;

/// Steps at the beginning of a fit that leave the shapes of effects alone: while an effect is weak its shape is told by
/// nothing, and a step in it would be wild.
const SHAPE_DELAY_STEPS: usize = 2;
/// Most that a step may move a nuisance.
const MAX_NUISANCE_STEP: f64 = 50.0;
/// Damping: at first, least, where a step has failed, and from where on there is no way down. By what it changes after a step
/// that succeeds and one that fails.
const INITIAL_DAMPING: f64 = 1e-4;
const MIN_DAMPING: f64 = 1e-8;
const MIN_DAMPING_AFTER_FAILURE: f64 = 1e-3;
const MAX_DAMPING: f64 = 1e5;
const DAMPING_DECREASE: f64 = 0.1;
const DAMPING_INCREASE: f64 = 30.0;
/// Share of the sum of squares (at most so much a trial), by less than which a fit that has settled still changes it.
const RELATIVE_TOLERANCE: f64 = 1e-4;
const TOLERANCE_SQUARE_PER_TRIAL: f64 = 50.0;

/// What one pass over all windows gives.
pub struct FitEvaluation {
    /// By trial.
    pub normal_equations: Vec<NormalEquations>,
    /// By window: residuals (m), two to a point, nuisances projected out.
    pub residuals: Vec<Vec<f64>>,
    /// By window: squares of the projected residual in units of the noise.
    pub squares: Vec<f64>,
    /// By window.
    nuisance_updates: Vec<NuisanceUpdate>,
}

/// Sums over the windows of one trial, in units of the noise.
#[derive(Clone)]
pub struct NormalEquations {
    pub gram: DMatrix<f64>,
    pub score: DVector<f64>,
    pub square: f64,
}

impl NormalEquations {
    /// The square with the slots `step` away.
    pub fn square_after(&self, step: &DVector<f64>) -> f64 {
        self.square - 2.0 * self.score.dot(step) + (step.transpose() * &self.gram * step)[(0, 0)]
    }
}

/// Fits a layout from a state in so many steps at most, and some more where effects have shapes; launches are alike.
pub fn fit(
    data: &SegmentData,
    layout: &ParameterLayout,
    start: FitState,
    most: usize,
) -> Result<(FitState, FitEvaluation)> {
    let mut state = FitState { random_effects: Vec::new(), ..start };
    let mut here = evaluate(data, layout, &state)?;
    let mut damping = INITIAL_DAMPING;
    let shaped = (0..layout.parameters.len()).any(|i| layout.is_shape(i));
    let held = if shaped { SHAPE_DELAY_STEPS } else { 0 };
    for round in 0..most + held {
        let step = levenberg_step(layout, &state.values, &here, damping, round < held);
        let tried = take_step(layout, &state, &step, &here.nuisance_updates);
        let there = evaluate(data, layout, &tried)?;
        let (old, new) = (penalised_square(layout, &state, &here), penalised_square(layout, &tried, &there));
        if new <= old * (1.0 + 1e-9) {
            (state, here) = (tried, there);
            damping = (damping * DAMPING_DECREASE).max(MIN_DAMPING);
            if round >= held
                && old - new
                    < RELATIVE_TOLERANCE * old.min(TOLERANCE_SQUARE_PER_TRIAL * data.trial_count as f64)
                        + 1e-6
            {
                break;
            }
        } else {
            damping = (damping * DAMPING_INCREASE).max(MIN_DAMPING_AFTER_FAILURE);
            if damping > MAX_DAMPING {
                break;
            }
        }
    }
    Ok((state, here))
}

/// Residuals, derivatives and sums at a state whose launches are alike.
fn evaluate(data: &SegmentData, layout: &ParameterLayout, state: &FitState) -> Result<FitEvaluation> {
    Ok(sum_by_trial(data, linearise(data, layout, state, &[])?, layout.parameters.len()))
}

/// What windows show, summed up by trial; their first columns are those of `q` slots.
pub fn sum_by_trial(data: &SegmentData, looks: Vec<Linearization>, q: usize) -> FitEvaluation {
    let empty = || NormalEquations { gram: DMatrix::zeros(q, q), score: DVector::zeros(q), square: 0.0 };
    let mut out = FitEvaluation {
        normal_equations: (0..data.trial_count).map(|_| empty()).collect(),
        residuals: Vec::new(),
        squares: Vec::new(),
        nuisance_updates: Vec::new(),
    };
    for (window, look) in data.segments.iter().zip(looks) {
        let sums = &mut out.normal_equations[window.trial];
        let columns = look.jacobian.columns(0, q);
        sums.gram += columns.tr_mul(&columns);
        sums.score += columns.tr_mul(&look.residual);
        sums.square += look.square;
        out.squares.push(look.square);
        out.residuals.push((0..2 * window.observations.len()).map(|i| look.residual_metres(i)).collect());
        out.nuisance_updates.push(look.nuisance_update);
    }
    out
}

/// Sum of squares of all trials.
pub fn total_square(pass: &FitEvaluation) -> f64 {
    pass.normal_equations.iter().map(|t| t.square).sum()
}

/// What a fit makes small: the sum of squares, and what values cost that are believed to be about nothing.
fn penalised_square(layout: &ParameterLayout, state: &FitState, pass: &FitEvaluation) -> f64 {
    total_square(pass)
        + layout.parameters.iter().zip(&state.values).map(|(s, v)| s.prior_precision * v * v).sum::<f64>()
}

/// A state after a step, as far as bounds allow it, every window's start with it.
fn take_step(
    layout: &ParameterLayout,
    state: &FitState,
    step: &DVector<f64>,
    corrections: &[NuisanceUpdate],
) -> FitState {
    let mut out = state.clone();
    let mut taken = DVector::zeros(step.len());
    for (i, slot) in layout.parameters.iter().enumerate() {
        out.values[i] = (state.values[i] + step[i]).clamp(slot.bounds[0], slot.bounds[1]);
        taken[i] = out.values[i] - state.values[i];
    }
    for (nuisances, correction) in out.nuisances.iter_mut().zip(corrections) {
        let moved = correction.step(&taken);
        nuisances
            .iter_mut()
            .zip(moved.iter())
            .for_each(|(n, m)| *n += m.clamp(-MAX_NUISANCE_STEP, MAX_NUISANCE_STEP));
    }
    out
}

fn levenberg_step(
    layout: &ParameterLayout,
    values: &[f64],
    pass: &FitEvaluation,
    damping: f64,
    hold_shapes: bool,
) -> DVector<f64> {
    let q = layout.parameters.len();
    let (mut gram, mut score) = (DMatrix::zeros(q, q), DVector::zeros(q));
    for t in &pass.normal_equations {
        gram += &t.gram;
        score += &t.score;
    }
    for (i, slot) in layout.parameters.iter().enumerate() {
        gram[(i, i)] += slot.prior_precision;
        score[i] -= slot.prior_precision * values[i];
    }
    // A value at its bound that is pushed outwards stays there, and the others step without it.
    for (i, slot) in layout.parameters.iter().enumerate() {
        if slot.is_at_active_bound(values[i], score[i]) || (hold_shapes && layout.is_shape(i)) {
            fix_parameter(&mut gram, &mut score, i);
        }
    }
    for i in 0..q {
        gram[(i, i)] = gram[(i, i)] * (1.0 + damping) + layout.parameters[i].min_information();
    }
    solve(&gram, &score)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{flights, term};
    use crate::world::Engine;

    fn fitted(wind: [f64; 2], names: &[&str], bounds: Option<[f64; 2]>) -> (FitState, FitEvaluation) {
        let (mut windows, settings) = flights(wind, 4);
        // Guesses of starts are off.
        windows.iter_mut().for_each(|w| w.nuisances[2] += 0.5);
        let data = SegmentData::new(&windows, &settings, vec![1e-3; 4], Engine::Auto);
        let mut layout = ParameterLayout::new(&[], names.iter().map(|n| term(n)).collect(), 1);
        layout.parameters[0].bounds = bounds.unwrap_or(layout.parameters[0].bounds);
        let nuisances = windows.iter().map(|w| w.nuisances.clone()).collect();
        fit(&data, &layout, FitState::new(layout.initial_values(&[0.0; 3]), nuisances), 8).unwrap()
    }

    fn most(pass: &FitEvaluation) -> f64 {
        pass.residuals.iter().flatten().fold(0.0, |most, r| r.abs().max(most))
    }

    /// A wind is found with every start, and nothing of what was seen is left.
    #[test]
    fn a_wind_is_found_with_every_start() {
        let (FitState { values, nuisances, .. }, pass) = fitted([0.8, -0.3], &["wind"], None);
        assert!((values[0] - 0.8).abs() < 1e-5 && (values[1] + 0.3).abs() < 1e-5, "{values:?}");
        assert!(nuisances.iter().all(|n| (n[2] - 3.0).abs() < 1e-5), "{nuisances:?}");
        assert!(most(&pass) < 1e-6, "{}", most(&pass));
    }

    /// Believed to be about nothing as firmly as the launches tell it, a wind is half of what they say.
    #[test]
    fn a_belief_pulls_towards_nothing() {
        let (windows, settings) = flights([0.8, -0.3], 4);
        let data = SegmentData::new(&windows, &settings, vec![1e-3; 4], Engine::Auto);
        let mut layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let start = FitState::new(vec![0.0; 2], windows.iter().map(|w| w.nuisances.clone()).collect());
        let told = evaluate(&data, &layout, &start)
            .unwrap()
            .normal_equations
            .iter()
            .map(|t| t.gram[(0, 0)])
            .sum::<f64>();
        layout.parameters[0].prior_precision = told;
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
