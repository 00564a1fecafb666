//! Least-squares fit of all segments by damped Gauss-Newton steps.
//!
//! Residuals and Jacobians, with nuisances projected out, are summed by trial into normal equations, which
//! suffice for fits and for held-out squares.
//!
//! Source: Levenberg (1944).

use nalgebra::{DMatrix, DVector};

use super::fit_state::FitState;
use super::linearization::{Linearization, NuisanceUpdate, linearise};
use super::parameters::ParameterLayout;
use super::segment_data::SegmentData;
use crate::error::Result;
use crate::inference::statistics::{fix_parameter, solve};

/// Number of initial steps with fixed shape parameters, which are not identifiable while amplitudes are near
/// zero.
const SHAPE_DELAY_STEPS: usize = 2;
/// Largest step of a nuisance.
const MAX_NUISANCE_STEP: f64 = 50.0;
/// Damping: initial, minimum, minimum after a failed step, and maximum, at which a fit ends; factors after a
/// successful and after a failed step.
const INITIAL_DAMPING: f64 = 1e-4;
const MIN_DAMPING: f64 = 1e-8;
const MIN_DAMPING_AFTER_FAILURE: f64 = 1e-3;
const MAX_DAMPING: f64 = 1e5;
const DAMPING_DECREASE: f64 = 0.1;
const DAMPING_INCREASE: f64 = 30.0;
/// Relative change of the sum of squares (at most this much per trial) below which a fit has converged.
const RELATIVE_TOLERANCE: f64 = 1e-4;
const TOLERANCE_SQUARE_PER_TRIAL: f64 = 50.0;

/// Evaluation of a model at a state.
pub struct FitEvaluation {
    /// Normal equations by trial.
    pub normal_equations: Vec<NormalEquations>,
    /// By segment: residuals (m), two per observation, nuisances projected out.
    pub residuals: Vec<Vec<f64>>,
    /// By segment: square of the projected residual in units of the noise.
    pub squares: Vec<f64>,
    /// By segment.
    nuisance_updates: Vec<NuisanceUpdate>,
}

/// Normal equations of one trial, in units of the noise.
#[derive(Clone)]
pub struct NormalEquations {
    pub gram: DMatrix<f64>,
    pub score: DVector<f64>,
    pub square: f64,
}

impl NormalEquations {
    /// Squared residual after a step of the parameters.
    pub fn square_after(&self, step: &DVector<f64>) -> f64 {
        self.square - 2.0 * self.score.dot(step) + (step.transpose() * &self.gram * step)[(0, 0)]
    }
}

/// Fits a layout from an initial state in at most `most` steps, and a few more with shape parameters; without
/// random effects.
pub fn fit(
    data: &SegmentData,
    layout: &ParameterLayout,
    start: FitState,
    most: usize,
) -> Result<(FitState, FitEvaluation)> {
    let mut state = FitState { random_effects: Vec::new(), ..start };
    let mut current = evaluate(data, layout, &state)?;
    let mut damping = INITIAL_DAMPING;
    let shaped = (0..layout.parameters.len()).any(|i| layout.is_shape(i));
    let held = if shaped { SHAPE_DELAY_STEPS } else { 0 };
    for round in 0..most + held {
        let step = levenberg_step(layout, &state.values, &current, damping, round < held);
        let proposed = take_step(layout, &state, &step, &current.nuisance_updates);
        let candidate = evaluate(data, layout, &proposed)?;
        let (old, new) =
            (penalised_square(layout, &state, &current), penalised_square(layout, &proposed, &candidate));
        if new <= old * (1.0 + 1e-9) {
            (state, current) = (proposed, candidate);
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
    Ok((state, current))
}

/// Evaluation at a state without random effects.
fn evaluate(data: &SegmentData, layout: &ParameterLayout, state: &FitState) -> Result<FitEvaluation> {
    Ok(sum_by_trial(data, linearise(data, layout, state, &[])?, layout.parameters.len()))
}

/// Sums linearizations by trial; the first `q` columns are those of the parameters.
pub fn sum_by_trial(data: &SegmentData, linearizations: Vec<Linearization>, q: usize) -> FitEvaluation {
    let empty = || NormalEquations { gram: DMatrix::zeros(q, q), score: DVector::zeros(q), square: 0.0 };
    let mut out = FitEvaluation {
        normal_equations: (0..data.trial_count).map(|_| empty()).collect(),
        residuals: Vec::new(),
        squares: Vec::new(),
        nuisance_updates: Vec::new(),
    };
    for (segment, linearization) in data.segments.iter().zip(linearizations) {
        let sums = &mut out.normal_equations[segment.trial];
        let columns = linearization.jacobian.columns(0, q);
        sums.gram += columns.tr_mul(&columns);
        sums.score += columns.tr_mul(&linearization.residual);
        sums.square += linearization.square;
        out.squares.push(linearization.square);
        out.residuals
            .push((0..2 * segment.observations.len()).map(|i| linearization.residual_metres(i)).collect());
        out.nuisance_updates.push(linearization.nuisance_update);
    }
    out
}

/// Squared residual of all trials.
pub fn total_square(evaluation: &FitEvaluation) -> f64 {
    evaluation.normal_equations.iter().map(|t| t.square).sum()
}

/// Objective of a fit: squared residual and prior penalty.
fn penalised_square(layout: &ParameterLayout, state: &FitState, evaluation: &FitEvaluation) -> f64 {
    total_square(evaluation)
        + layout.parameters.iter().zip(&state.values).map(|(s, v)| s.prior_precision * v * v).sum::<f64>()
}

/// State after a step, clamped to the bounds, with the nuisances updated.
fn take_step(
    layout: &ParameterLayout,
    state: &FitState,
    step: &DVector<f64>,
    corrections: &[NuisanceUpdate],
) -> FitState {
    let mut out = state.clone();
    let mut taken = DVector::zeros(step.len());
    for (i, parameter) in layout.parameters.iter().enumerate() {
        out.values[i] = (state.values[i] + step[i]).clamp(parameter.bounds[0], parameter.bounds[1]);
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
    evaluation: &FitEvaluation,
    damping: f64,
    hold_shapes: bool,
) -> DVector<f64> {
    let q = layout.parameters.len();
    let (mut gram, mut score) = (DMatrix::zeros(q, q), DVector::zeros(q));
    for t in &evaluation.normal_equations {
        gram += &t.gram;
        score += &t.score;
    }
    for (i, parameter) in layout.parameters.iter().enumerate() {
        gram[(i, i)] += parameter.prior_precision;
        score[i] -= parameter.prior_precision * values[i];
    }
    // Parameters at active bounds are fixed for the step.
    for (i, parameter) in layout.parameters.iter().enumerate() {
        if parameter.is_at_active_bound(values[i], score[i]) || (hold_shapes && layout.is_shape(i)) {
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
    use crate::inference::testing::segments::{flights, term};
    use crate::world::Engine;

    fn fitted(wind: [f64; 2], names: &[&str], bounds: Option<[f64; 2]>) -> (FitState, FitEvaluation) {
        let (mut segments, settings) = flights(wind, 4);
        // Wrong initial guesses.
        segments.iter_mut().for_each(|w| w.nuisances[2] += 0.5);
        let data = SegmentData::new(&segments, &settings, vec![1e-3; 4], Engine::Auto);
        let mut layout = ParameterLayout::new(&[], names.iter().map(|n| term(n)).collect(), 1);
        layout.parameters[0].bounds = bounds.unwrap_or(layout.parameters[0].bounds);
        let nuisances = segments.iter().map(|w| w.nuisances.clone()).collect();
        fit(&data, &layout, FitState::new(layout.initial_values(&[0.0; 3]), nuisances), 8).unwrap()
    }

    fn most(evaluation: &FitEvaluation) -> f64 {
        evaluation.residuals.iter().flatten().fold(0.0, |most, r| r.abs().max(most))
    }

    /// Recovers a wind and all initial states; residuals vanish.
    #[test]
    fn wind_and_initial_states_are_recovered() {
        let (FitState { values, nuisances, .. }, evaluation) = fitted([0.8, -0.3], &["wind"], None);
        assert!((values[0] - 0.8).abs() < 1e-5 && (values[1] + 0.3).abs() < 1e-5, "{values:?}");
        assert!(nuisances.iter().all(|n| (n[2] - 3.0).abs() < 1e-5), "{nuisances:?}");
        assert!(most(&evaluation) < 1e-6, "{}", most(&evaluation));
    }

    /// A prior as precise as the data halves the estimate.
    #[test]
    fn a_prior_shrinks_the_estimate() {
        let (segments, settings) = flights([0.8, -0.3], 4);
        let data = SegmentData::new(&segments, &settings, vec![1e-3; 4], Engine::Auto);
        let mut layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let start = FitState::new(vec![0.0; 2], segments.iter().map(|w| w.nuisances.clone()).collect());
        let information = evaluate(&data, &layout, &start)
            .unwrap()
            .normal_equations
            .iter()
            .map(|t| t.gram[(0, 0)])
            .sum::<f64>();
        layout.parameters[0].prior_precision = information;
        let (state, _) = fit(&data, &layout, start, 8).unwrap();
        assert!((state.values[0] - 0.4).abs() < 1e-3, "{:?}", state.values);
        assert!((state.values[1] + 0.3).abs() < 1e-3, "{:?}", state.values);
    }

    /// With the wind at its bound the other parameters are fitted as if it were known.
    #[test]
    fn active_bounds_do_not_affect_other_parameters() {
        let (state, _) = fitted([-0.8, 0.0], &["wind", "linear_drag"], Some([-0.5, 0.5]));
        assert_eq!(state.values[0], -0.5);
        assert!(state.values[2] > 0.05, "{:?}", state.values);
    }
}
