//! Fit of a model to all trials, with its evidence.
//!
//! First by least squares (`model::fit`), then by generalised least squares with the shared discrepancy and
//! variance components, linearized at the conditional modes until convergence. The variance components are
//! those of the recording ([`RecordingContext`]), estimated once from the richest model, so that no model
//! attributes its misfit to noise.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use crate::error::{Error, Result};
use crate::inference::data::noise::Noise;
use crate::inference::mixed_model::conditional_modes;
use crate::inference::mixed_model::coordinates::{SegmentCoordinates, segment_coordinates};
use crate::inference::mixed_model::cross_validation;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::group_statistics::{self, GroupStatistics, VarianceComponents};
use crate::inference::mixed_model::groups::{self, Group};
use crate::inference::mixed_model::leave_group_out::leave_group_out;
use crate::inference::mixed_model::random_design::{RandomDesign, nuisance_accelerations};
use crate::inference::mixed_model::variance_components::{ComponentLikelihood, INITIAL_STEP, WARM_STEP};
use crate::inference::model::{
    self, FitState, Linearization, ParameterLayout, Perturbation, RandomEffects, SegmentData, Term,
};
use crate::inference::segment::Segment;
use crate::inference::selection::candidates;
use crate::inference::selection::{
    FixedEffectsPrior, Laplace, SharedDiscrepancy, damped_step, marginal_evidence, profile_log_posterior,
};
use crate::world::effect::DataRange;

/// Maximum number of rounds of generalised least squares at a design of the random effects, of designs, and convergence
/// tolerance, nats.
const MAX_GLS_ROUNDS: usize = 8;
const DESIGN_UPDATES: usize = 2;
const GLS_TOLERANCE: f64 = 0.05;
/// Excess of the linearised log posterior over the actual one, nats, above which a fit has not converged.
const LINEARISATION_TOLERANCE: f64 = 1.0;
/// Evidence that an edge beyond all observations costs, nats: half of its prior lies between them, and Laplace's integral
/// over the normal prior counts that half too.
const UNOBSERVED_EDGE: f64 = std::f64::consts::LN_2;
/// Levenberg-Marquardt damping of the parameters, as a share of their information: first, after a failure, after a success, and
/// the largest one.
const FIRST_DAMPING: f64 = 0.1;
const DAMPING_INCREASE: f64 = 8.0;
const DAMPING_DECREASE: f64 = 0.1;
const MAX_DAMPING: f64 = 1.0;

/// Estimates of a recording that are the same for every set of effects.
#[derive(Clone)]
pub struct RecordingContext {
    pub discrepancy: SharedDiscrepancy,
    pub components: VarianceComponents,
    /// Norm of the response to each random acceleration in the richest model.
    pub responses: Vec<f64>,
}

impl RecordingContext {
    /// Components for a model whose responses to random accelerations differ, for example by a clock error:
    /// their observed effect is the same for every model.
    fn components_at(&self, responses: &[f64]) -> VarianceComponents {
        let mut out = self.components.clone();
        for (acceleration, (richest, own)) in
            out.accelerations.iter_mut().zip(self.responses.iter().zip(responses))
        {
            *acceleration *= if *own > 0.0 && *richest > 0.0 { richest / own } else { 1.0 };
        }
        out
    }
}

/// Norms of the responses of flights and contacts to random accelerations, whose columns follow those of the parameters.
pub fn acceleration_responses(
    segments: &[Segment],
    linearizations: &[Linearization],
    parameters: usize,
) -> Vec<f64> {
    let of = |k: usize| {
        let flying = segments.iter().zip(linearizations).filter(|(segment, _)| segment.kind.is_airborne());
        flying.map(|(_, l)| l.jacobian.column(parameters + k).norm_squared()).sum::<f64>().sqrt()
    };
    (0..nuisance_accelerations().len()).map(of).collect()
}

/// Iterate of generalised least squares.
struct Iterate {
    /// Log posterior density.
    log_posterior: f64,
    state: FitState,
    /// Parameters by which amplitudes vary between trials.
    design_values: Vec<f64>,
    prior: FixedEffectsPrior,
    linearizations: Vec<Linearization>,
    groups: Vec<Group>,
    group_statistics: Vec<GroupStatistics>,
    components: VarianceComponents,
    laplace: Laplace,
}

/// Fits models of one recording.
#[derive(Clone)]
pub struct ModelFitter<'a, 'b> {
    pub data: &'b SegmentData<'a>,
    pub coordinates: Vec<SegmentCoordinates>,
    /// By segment: ratio of its residual standard deviation to the noise.
    pub scales: Vec<f64>,
    pub folds: Vec<usize>,
    /// Ranges of position, speed and time in the data.
    pub range: DataRange,
    /// m/s^2
    pub gravity: f64,
    context: Option<RecordingContext>,
    /// Responses of each segment to the shared discrepancy of the context, in its coordinates.
    discrepancy_columns: Vec<DMatrix<f64>>,
}

impl<'a, 'b> ModelFitter<'a, 'b> {
    /// Without shared discrepancy; every model estimates its variance components.
    pub fn new(data: &'b SegmentData<'a>, noise: &Noise) -> ModelFitter<'a, 'b> {
        let scale = |(w, sd): (&crate::inference::segment::Segment, &f64)| match w.kind {
            kind if kind.is_impact() => sd / noise.sd,
            _ if sd.is_finite() => 1.0,
            _ => f64::NAN,
        };
        ModelFitter {
            data,
            coordinates: segment_coordinates(data.segments, noise),
            scales: data.segments.iter().zip(&data.sd).map(scale).collect(),
            folds: cross_validation::folds(data.settings),
            range: candidates::data_range(data.segments),
            gravity: candidates::max_gravity(data.segments),
            context: None,
            discrepancy_columns: Vec::new(),
        }
    }

    /// The same with the estimates that all models of the recording share.
    pub fn with_context(self, context: RecordingContext) -> Self {
        let responses = context.discrepancy.responses.iter().enumerate();
        let discrepancy_columns = responses.map(|(w, own)| self.in_coordinates(w, own)).collect();
        ModelFitter { context: Some(context), discrepancy_columns, ..self }
    }

    pub fn context(&self) -> Option<&RecordingContext> {
        self.context.as_ref()
    }

    /// Fits a layout from an initial state; `None` if it cannot be simulated or its covariance is singular.
    pub fn fit(
        &self,
        layout: ParameterLayout,
        start: FitState,
        rounds: usize,
    ) -> Result<Option<FittedModel>> {
        match self.least_squares(&layout, start, rounds)? {
            Some(state) => self.run_gls(layout, state),
            None => Ok(None),
        }
    }

    /// State after least squares; `None` if the layout cannot be simulated.
    pub fn least_squares(
        &self,
        layout: &ParameterLayout,
        start: FitState,
        rounds: usize,
    ) -> Result<Option<FitState>> {
        Ok(none_if_not_simulable(model::fit(self.data, layout, start, rounds))?.map(|(state, _)| state))
    }

    /// Generalised least squares from a nearby state; steps that decrease the posterior are repeated with more damping.
    pub fn run_gls(&self, layout: ParameterLayout, state: FitState) -> Result<Option<FittedModel>> {
        let best = self.gls_iterations(&layout, state)?;
        Ok(best.and_then(|best| self.fitted_model(layout, best)))
    }

    /// Log joint density of a fitted model with one parameter fixed at another value and all others at their
    /// mode.
    pub fn log_joint_with(&self, fit: &FittedModel, slot: usize, value: f64) -> Result<Option<f64>> {
        let (mut layout, mut state) = (fit.layout.clone(), fit.state.clone());
        layout.parameters[slot].is_fixed = true;
        state.values[slot] = value;
        Ok(self.gls_iterations(&layout, state)?.map(|iterate| iterate.log_posterior))
    }

    /// Final iterate of generalised least squares from a nearby state. The design of the random effects is held while parameters
    /// move, so that their steps increase one posterior, and is then updated.
    fn gls_iterations(&self, layout: &ParameterLayout, state: FitState) -> Result<Option<Iterate>> {
        let first = VarianceComponents::initial(!layout.terms.is_empty());
        let values = state.values.clone();
        let Some(mut best) = self.evaluate(layout, state, values, (&first, INITIAL_STEP))? else {
            return Ok(None);
        };
        if best.groups.iter().any(|group| group.has_random_effects) {
            // Posteriors are comparable if all are linearized at the modes of the random effects.
            let mut modes_only = best.laplace.step.clone();
            modes_only.rows_mut(0, layout.parameters.len()).fill(0.0);
            let next = self.take_step(layout, &best, modes_only);
            best = self.evaluate_like(layout, next, &best)?.unwrap_or(best);
        }
        for _ in 0..DESIGN_UPDATES {
            best = self.at_fixed_design(layout, best)?;
            if best.state.values == best.design_values {
                break;
            }
            let (state, values) = (best.state.clone(), best.state.values.clone());
            best = self.evaluate(layout, state, values, (&best.components, WARM_STEP))?.unwrap_or(best);
        }
        Ok(Some(best))
    }

    /// The most probable iterate at the design of another, by the method of Levenberg and Marquardt.
    fn at_fixed_design(&self, layout: &ParameterLayout, mut best: Iterate) -> Result<Iterate> {
        let mut damping = 0.0;
        for _ in 0..MAX_GLS_ROUNDS {
            let expected = best.laplace.log_joint - best.log_posterior;
            let step = damped_step(&best.group_statistics, &best.prior, &best.laplace, damping);
            let (true, Some(step)) = (expected >= GLS_TOLERANCE, step) else { break };
            let next = self.take_step(layout, &best, step);
            let Some(candidate) = self.evaluate_like(layout, next, &best)? else { break };
            let gained = candidate.log_posterior - best.log_posterior;
            damping = match gained > 0.0 {
                true => damping * DAMPING_DECREASE,
                false => (damping * DAMPING_INCREASE).max(FIRST_DAMPING),
            };
            if gained > 0.0 {
                best = candidate;
            }
            // The determinant of the covariance changes as well, which the step ignores.
            if (-LINEARISATION_TOLERANCE..GLS_TOLERANCE).contains(&gained) || damping > MAX_DAMPING {
                break;
            }
        }
        Ok(best)
    }

    /// The iterate at another state with the design of `like`; without a context its components are estimated anew.
    fn evaluate_like(
        &self,
        layout: &ParameterLayout,
        state: FitState,
        like: &Iterate,
    ) -> Result<Option<Iterate>> {
        self.evaluate(layout, state, like.design_values.clone(), (&like.components, WARM_STEP))
    }

    /// The iterate at a state; `None` if it cannot be simulated or its covariance is singular. `design_values`: parameters by
    /// which amplitudes vary between trials; `from`: initial components with the first step of their estimation.
    fn evaluate(
        &self,
        layout: &ParameterLayout,
        state: FitState,
        design_values: Vec<f64>,
        from: (&VarianceComponents, f64),
    ) -> Result<Option<Iterate>> {
        let Some(linearizations) =
            none_if_not_simulable(model::linearise(self.data, layout, &state, &nuisance_accelerations()))?
        else {
            return Ok(None);
        };
        let prior = self.prior(layout, &state);
        let design = RandomDesign::of(layout, &design_values, self.gravity);
        let Some(linearized_groups) = self.groups_by_design(&design, &linearizations)? else {
            return Ok(None);
        };
        let components = match &self.context {
            Some(context) => {
                let responses =
                    acceleration_responses(self.data.segments, &linearizations, layout.parameters.len());
                context.components_at(&responses)
            }
            None => {
                ComponentLikelihood::new(&linearized_groups, from.0).maximise(from.1, self.data.progress)?
            }
        };
        let statistics =
            group_statistics::group_statistics(&linearized_groups, &components, self.data.progress)?;
        let Some(statistics) = statistics else {
            return Ok(None);
        };
        self.data.progress.check_stop()?;
        let Some(laplace) = marginal_evidence(&statistics, &prior) else { return Ok(None) };
        let log_posterior = profile_log_posterior(&statistics, &prior, laplace.scale);
        Ok(Some(Iterate {
            log_posterior,
            state,
            design_values,
            prior,
            linearizations,
            groups: linearized_groups,
            group_statistics: statistics,
            components,
            laplace,
        }))
    }

    /// State after a step of parameters and discrepancy, random effects at their conditional modes.
    fn take_step(&self, layout: &ParameterLayout, iterate: &Iterate, mut all: DVector<f64>) -> FitState {
        let mut state = iterate.state.clone();
        let columns = RandomDesign::of(layout, &iterate.design_values, self.gravity);
        let step = all.rows(0, layout.parameters.len()).into_owned();
        let clamped = clamp_step(layout, &state.values, &step);
        let (linearized_groups, linearizations) = (&iterate.groups, &iterate.linearizations);
        all.rows_mut(0, clamped.len()).copy_from(&clamped);
        let mut modes = conditional_modes::conditional_modes(
            linearized_groups,
            &columns,
            &nuisance_accelerations(),
            &iterate.components,
            &all,
            linearizations.len(),
        );
        // If one axis is not observed, a random acceleration along it would only act in second order.
        let unseen = modes.iter_mut().zip(&self.coordinates).filter(|(_, own)| !own.moves_in_plane());
        unseen.flat_map(|(mode, _)| &mut mode.accelerations).for_each(|acceleration| acceleration.1 = 0.0);
        apply_step(&mut state, linearizations, &clamped, modes);
        state
    }

    /// The fitted model of the final iterate.
    fn fitted_model(&self, layout: ParameterLayout, iterate: Iterate) -> Option<FittedModel> {
        let Iterate {
            log_posterior,
            state,
            prior,
            linearizations,
            groups: linearized_groups,
            group_statistics: statistics,
            components,
            laplace,
            ..
        } = iterate;
        let q = layout.parameters.len();
        // Without convergence the linearisation overestimates the evidence.
        let excess = laplace.log_joint - log_posterior - LINEARISATION_TOLERANCE;
        let is_unobserved_edge =
            |i: &usize| layout.is_discontinuous(*i) && !is_informed(*i, &statistics, &prior);
        let unobserved_edges = (0..q).filter(is_unobserved_edge).count();
        let log_evidence = laplace.log_evidence - excess.max(0.0) - unobserved_edges as f64 * UNOBSERVED_EDGE;
        let discrepancy_mode = laplace.step.rows(q, laplace.step.len() - q).into_owned();
        let mut step = laplace.step.clone();
        step.rows_mut(q, discrepancy_mode.len()).fill(0.0);
        let mut squares = vec![0.0; self.data.trial_count];
        for group in &linearized_groups {
            squares[group.trial] += group.square_at(&step);
        }
        let evaluation = model::sum_by_trial(self.data, linearizations, q);
        let groups: Vec<usize> = (0..evaluation.normal_equations.len()).collect();
        let (held, held_out_steps) = leave_group_out(
            &layout,
            &state.values,
            &evaluation.normal_equations,
            self.data.settings,
            &groups,
            &[],
        );
        Some(FittedModel {
            effects: layout.terms.iter().map(|t| t.effect).collect(),
            group_statistics: statistics.iter().map(|t| t.first_parameters(q)).collect(),
            layout,
            state,
            evaluation,
            held_out_squares: held,
            held_out_steps,
            log_evidence,
            log_joint: log_posterior,
            discrepancy_scale: laplace.scale,
            discrepancy_mode,
            squares,
            components,
            covariance: laplace.covariance,
            prior,
            gravity: self.gravity,
        })
    }

    /// Linearizations and groups at a state, with columns for `perturbations` after those of the parameters.
    pub fn groups(
        &self,
        layout: &ParameterLayout,
        state: &FitState,
        perturbations: &[Perturbation],
    ) -> Result<Option<(Vec<Linearization>, Vec<Group>)>> {
        let all: Vec<Perturbation> =
            nuisance_accelerations().into_iter().chain(perturbations.iter().cloned()).collect();
        let Some(linearizations) = none_if_not_simulable(model::linearise(self.data, layout, state, &all))?
        else {
            return Ok(None);
        };
        let design = RandomDesign::of(layout, &state.values, self.gravity);
        let linearized_groups = self.reduce_to_groups(&design, &linearizations, |_| None)?;
        Ok(linearized_groups.map(|linearized_groups| (linearizations, linearized_groups)))
    }

    /// As [`ModelFitter::groups`], with additional columns by segment: two rows per observation, m; as many of each segment.
    pub fn groups_with_columns(
        &self,
        layout: &ParameterLayout,
        state: &FitState,
        columns: &dyn Fn(usize) -> DMatrix<f64>,
    ) -> Result<Option<Vec<Group>>> {
        let Some(linearizations) =
            none_if_not_simulable(model::linearise(self.data, layout, state, &nuisance_accelerations()))?
        else {
            return Ok(None);
        };
        let design = RandomDesign::of(layout, &state.values, self.gravity);
        self.reduce_to_groups(&design, &linearizations, |w| {
            Some(Cow::Owned(self.in_coordinates(w, &columns(w))))
        })
    }

    /// White coordinates of displacements of a segment's observations (two rows per observation, m).
    fn in_coordinates(&self, w: usize, displacements: &DMatrix<f64>) -> DMatrix<f64> {
        let points = &self.data.segments[w].observations;
        let weight = |i: usize| points[i / 2].weight.sqrt() / self.data.sd[w];
        let weighted = DMatrix::from_fn(displacements.nrows(), displacements.ncols(), |i, k| {
            weight(i) * displacements[(i, k)]
        });
        self.coordinates[w].white(&weighted, [self.scales[w], 0.0])
    }

    /// Groups with the columns of the shared discrepancy after those of the parameters.
    pub fn groups_with_discrepancy(
        &self,
        layout: &ParameterLayout,
        state: &FitState,
        linearizations: &[Linearization],
    ) -> Result<Option<Vec<Group>>> {
        self.groups_by_design(&RandomDesign::of(layout, &state.values, self.gravity), linearizations)
    }

    /// The same with a given design of the random effects.
    fn groups_by_design(
        &self,
        design: &RandomDesign,
        linearizations: &[Linearization],
    ) -> Result<Option<Vec<Group>>> {
        self.reduce_to_groups(design, linearizations, |w| self.discrepancy_columns.get(w).map(Cow::Borrowed))
    }

    fn reduce_to_groups<'l>(
        &self,
        design: &RandomDesign,
        linearizations: &[Linearization],
        more: impl Fn(usize) -> Option<Cow<'l, DMatrix<f64>>>,
    ) -> Result<Option<Vec<Group>>> {
        groups::groups(self.data, &self.coordinates, linearizations, more, design, &self.scales)
    }
}

/// Whether the data contain more information about a parameter than its prior.
fn is_informed(parameter: usize, statistics: &[GroupStatistics], prior: &FixedEffectsPrior) -> bool {
    let information = statistics.iter().map(|g| g.gram[(parameter, parameter)]).sum::<f64>();
    information >= prior.precision[(parameter, parameter)]
}

/// A step clamped to the bounds; fixed parameters do not move.
fn clamp_step(layout: &ParameterLayout, values: &[f64], step: &DVector<f64>) -> DVector<f64> {
    let parameters = layout.parameters.iter().zip(values).zip(step.iter());
    let clamped = parameters.map(|((slot, v), s)| match slot.is_fixed {
        true => 0.0,
        false => (v + s).clamp(slot.bounds[0], slot.bounds[1]) - v,
    });
    DVector::from_iterator(step.len(), clamped)
}

/// Applies a step to the parameters, sets the random effects, and updates the nuisances.
fn apply_step(
    state: &mut FitState,
    linearizations: &[Linearization],
    clamped: &DVector<f64>,
    modes: Vec<RandomEffects>,
) {
    state.values.iter_mut().zip(clamped.iter()).for_each(|(v, step)| *v += step);
    for (w, mode) in modes.iter().enumerate() {
        let before = state.random_effects.get(w);
        let size = |k: usize| mode.deviations[k] - before.map_or(0.0, |m| m.deviations[k]);
        let acceleration = |k: usize| mode.accelerations[k].1 - before.map_or(0.0, |m| m.accelerations[k].1);
        let parameters = (0..clamped.len()).map(|k| clamped[k] + size(k));
        let all = parameters.chain((0..mode.accelerations.len()).map(acceleration)).collect::<Vec<_>>();
        let moved = linearizations[w].nuisance_step(&DVector::from_vec(all));
        state.nuisances[w].iter_mut().zip(moved.iter()).for_each(|(n, m)| *n += m.clamp(-50.0, 50.0));
    }
    state.random_effects = modes;
}

impl ModelFitter<'_, '_> {
    /// Prior of the parameters relative to a state.
    pub fn prior(&self, layout: &ParameterLayout, state: &FitState) -> FixedEffectsPrior {
        FixedEffectsPrior::of(layout, &state.values, &self.range, self.gravity)
    }
}

/// `None` for a model that cannot be simulated; other errors propagate.
pub fn none_if_not_simulable<T>(fitted: Result<T>) -> Result<Option<T>> {
    match fitted {
        Ok(found) => Ok(Some(found)),
        Err(Error::Input(_) | Error::Failed(_)) => Ok(None),
        Err(other) => Err(other),
    }
}

/// Initial values of a term with amplitudes `sizes`, inside the bounds.
pub fn with_amplitudes(term: &Term, sizes: &[f64]) -> Vec<f64> {
    let mut sizes = sizes.iter();
    let value = |(p, parameter): (usize, &crate::world::effect::ParameterDeclaration)| {
        if !parameter.is_amplitude() || !term.free[p] {
            return term.start[p];
        }
        let value = parameter.neutral + sizes.next().copied().unwrap_or(0.0);
        let [low, high] = parameter.bounds;
        // Off the bound, where derivatives vanish.
        let hair = 1e-3 * parameter.fd_step;
        value.clamp(low, high).max(if low == parameter.neutral { low + hair } else { low })
    };
    term.effect.parameters.iter().enumerate().map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::term;

    #[test]
    fn steps_are_clamped_to_bounds() {
        let layout = ParameterLayout::new(&[], vec![term("quadratic_drag"), term("lift")], 1);
        let step = DVector::from_vec(vec![-0.5, -0.5]);
        assert_eq!(clamp_step(&layout, &[0.1, 0.1], &step).as_slice(), [-0.1, -0.5]);
    }
}
