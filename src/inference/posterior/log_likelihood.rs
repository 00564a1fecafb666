//! Log likelihood of trials at any latents and effect parameters.
//!
//! Segments are simulated at the parameters from the initial states of the fit. Their residuals are projected
//! onto the complement of the nuisances' Jacobian (restricted likelihood) and whitened under the variance
//! components of the trials. If groups depend on variance components, the likelihood is the mean over
//! components drawn at the fit, each relative to its likelihood at the fit ([`super::conditional`]). Groups are
//! multivariate Student t. A shared force field that the model lacks is integrated out
//! ([`super::discrepancy`]).
//!
//! Sources: as in `groups`; model discrepancy: Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425.
//!
//! Differences from the source: the dependence of segments on their initial states is linearised at the fit.
//! Variance components are drawn once, at the fit, with upper bounds from there: the average is inaccurate far
//! from the fit. At the fit the likelihood equals that of the fit's components, so log evidence includes no
//! penalty for more components.

use std::borrow::Cow;

use nalgebra::DVector;
use rayon::prelude::*;

use super::basis_field::{BasisField, DiscrepancyModel};
use super::conditional::{BlockIndex, ConditionalLikelihood};
use super::discrepancy::DiscrepancyField;
use super::sampled_field::{SCALE_MIXTURE_PRIOR, SampledField};
use crate::budget::Budget;
use crate::error::Result;
use crate::estimate::discrepancy_forces::DiscrepancyForces;
use crate::estimate::sampler::{
    JointPrior, Marginal, ReferenceDensity, Target, log_sum_exp, sample_categorical,
};
use crate::inference::field::FieldInputs;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::groups::{self, Group};
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::mixed_model::variance_components;
use crate::inference::model::{self, FitState, Linearization, ParameterLayout, RandomEffects};
use crate::inference::segment::Segment;
use crate::rng;
use crate::task::Scene;
use crate::world::{Engine, ParameterVector, Rollout, Simulator};

/// Scale inflation of the reference density relative to the fit.
pub const REFERENCE_INFLATION: f64 = 1.5;
/// Points per simulation batch.
const POINTS_PER_BATCH: usize = 64;
/// Number of draws of the variance components.
const COMPONENT_DRAWS: usize = 16;

/// A likelihood ready for evaluation.
pub struct LogLikelihood {
    layout: ParameterLayout,
    prior: JointPrior,
    engine: Engine,
    segments: Vec<CachedSegment>,
    /// Conditional likelihoods, one per draw of the variance components (without draws whose covariance fails);
    /// only the fit's if groups do not depend on them.
    conditionals: Vec<ConditionalLikelihood>,
    /// Basis of each kind of discrepancy field.
    kinds: Vec<BasisField>,
    /// The field that is part of the model, if any.
    sampled_field: Option<SampledField>,
}

/// Draws of discrepancy fields of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldDraws {
    pub over: FieldInputs,
    pub forces: DiscrepancyForces,
}

/// Segments that depend on the parameters, and their block indices.
type CachedSegments = (Vec<CachedSegment>, Vec<BlockIndex>);

/// Posterior of the discrepancy.
pub struct DiscrepancySummary {
    /// Probability of each field averaged over points, no field first.
    pub fields: Vec<(DiscrepancyField, f64)>,
    /// Draws of the fields, by kind.
    pub draws: Vec<FieldDraws>,
}

/// A segment that depends on the parameters.
struct CachedSegment {
    segment: Segment,
    /// The scene at the segment's initial state.
    scene: Scene,
    nuisances: Vec<f64>,
    mode: Option<RandomEffects>,
    /// Prediction at the fit, two coordinates per observation, m.
    prediction: Vec<f64>,
    /// Index of its group.
    group: usize,
}

impl LogLikelihood {
    /// Prepares the likelihood of a fitted model with its discrepancy model; `seed`: for draws of the
    /// components. `None` if the model cannot be simulated or its covariance fails.
    pub fn new(
        fitter: &ModelFitter,
        fit: &FittedModel,
        prior: JointPrior,
        discrepancy_model: &DiscrepancyModel,
        seed: u64,
    ) -> Result<Option<LogLikelihood>> {
        let (data, layout, state) = (fitter.data, &fit.layout, &fit.state);
        let Some((linearizations, groups)) =
            fitter.groups(layout, state, &discrepancy_model.perturbations())?
        else {
            return Ok(None);
        };
        let (windows, block_indices) = cache_segments(fitter, fit, &linearizations, &groups)?;
        let new = |c, before| {
            ConditionalLikelihood::new(
                &groups,
                &block_indices,
                c,
                layout.parameters.len(),
                (discrepancy_model, before),
                data.progress,
            )
        };
        let Some(at_fit) = new(&fit.components, None)? else { return Ok(None) };
        let sampled_field = match discrepancy_model {
            DiscrepancyModel::Sampled(unnamed) => {
                match SampledField::new(&at_fit.groups, unnamed, &fit.prior.precision) {
                    None => return Ok(None),
                    found => found,
                }
            }
            DiscrepancyModel::Absent | DiscrepancyModel::Marginalised(_) => None,
        };
        let mut objective = variance_components::ComponentLikelihood::new(&groups, &fit.components);
        let mut conditional = Vec::new();
        if objective.depends_on_components() {
            let drawn =
                objective.sample(COMPONENT_DRAWS, &mut rng::stream(seed, "components"), data.progress)?;
            let one = |c| Ok(new(c, Some(&at_fit))?.map(ConditionalLikelihood::drop_jacobians));
            let all = drawn.par_iter().map(one).collect::<Result<Vec<_>>>()?;
            conditional = all.into_iter().flatten().collect();
        }
        if conditional.is_empty() {
            conditional.push(at_fit.drop_jacobians());
        }
        let drawn = sampled_field
            .iter()
            .flat_map(|sampled_field| sampled_field.coefficients())
            .map(|_| SCALE_MIXTURE_PRIOR);
        let prior = JointPrior::new(prior.marginals().iter().copied().chain(drawn).collect())?;
        Ok(Some(LogLikelihood {
            layout: layout.clone(),
            prior,
            engine: data.engine,
            segments: windows,
            conditionals: conditional,
            kinds: discrepancy_model.kinds(),
            sampled_field,
        }))
    }

    /// Number of simulated segments, and of groups.
    pub fn sizes(&self) -> (usize, usize) {
        (self.segments.len(), self.conditionals[0].groups.len())
    }

    /// Approximate memory without the segments' scenes, bytes.
    pub fn bytes(&self) -> usize {
        let windows = self.segments.iter().map(|k| 4 * k.prediction.len());
        size_of::<f64>()
            * windows.chain(self.conditionals.iter().map(ConditionalLikelihood::stored_floats)).sum::<usize>()
    }

    /// Reference density around the fit, or around the linearised posterior mode if a field is sampled.
    pub fn reference(&self, fit: &FittedModel) -> ReferenceDensity {
        let inside = |(v, m): (&f64, &Marginal)| {
            let [low, high] = m.bounds();
            v.clamp(low, high)
        };
        let (likeliest, covariance) = match &self.sampled_field {
            Some(sampled_field) => {
                let (at, covariance) = sampled_field.posterior_mode(&fit.state.values);
                (at, covariance.clone())
            }
            None => (fit.state.values.clone(), fit.covariance.clone()),
        };
        let at: Vec<f64> = likeliest.iter().zip(self.prior.marginals()).map(inside).collect();
        ReferenceDensity::new(&at, &covariance, REFERENCE_INFLATION, &self.prior)
    }

    /// The model's layout at a point.
    fn layout_at(&self, point: &[f64]) -> Cow<'_, ParameterLayout> {
        match &self.sampled_field {
            Some(sampled_field) => Cow::Owned(sampled_field.layout(&self.layout, point)),
            None => Cow::Borrowed(&self.layout),
        }
    }

    /// By point and segment: prediction minus the prediction at the fit, with the sign of a residual, m.
    fn prediction_deltas(
        &self,
        points: &[ParameterVector],
        budget: &dyn Budget,
    ) -> Result<Vec<Vec<DVector<f64>>>> {
        let simulated: Vec<usize> =
            (0..self.segments.len()).filter(|w| self.segments[*w].segment.kind.uses_engine()).collect();
        let integrated: Vec<usize> =
            (0..self.segments.len()).filter(|w| !self.segments[*w].segment.kind.uses_engine()).collect();
        let layouts: Vec<Cow<ParameterLayout>> = points.iter().map(|p| self.layout_at(p)).collect();
        let mut physics = Vec::with_capacity(points.len() * simulated.len());
        // In segment order, so that a batch simulates the same scene.
        for w in &simulated {
            budget.check()?;
            let window = &self.segments[*w].segment;
            let at = layouts.iter().zip(points);
            physics.extend(at.map(|(layout, p)| layout.effects_and_latents(p, window.setting, window.start)));
        }
        let n = points.len().max(1);
        let of = |i: usize| &self.segments[simulated[i / n]];
        let rollouts: Vec<Rollout> = physics
            .iter()
            .enumerate()
            .map(|(i, physics)| of(i).segment.rollout(&of(i).scene, physics))
            .collect();
        let by_engine = Simulator::new(self.engine).budget(budget).map(&rollouts, |i, path| {
            let w = simulated[i / n];
            self.segments[w]
                .prediction_delta(&model::positions_at_observations(&self.segments[w].segment, &path))
        })?;
        let by_hand = |i: usize| -> Result<DVector<f64>> {
            budget.check()?;
            let cached = &self.segments[integrated[i / n]];
            let state = FitState {
                random_effects: cached.mode.iter().cloned().collect(),
                ..FitState::new(points[i % n].clone(), vec![cached.nuisances.clone()])
            };
            Ok(cached.prediction_delta(&model::predict_segment(&cached.segment, &layouts[i % n], &state)))
        };
        let by_hand: Vec<DVector<f64>> =
            (0..integrated.len() * points.len()).into_par_iter().map(by_hand).collect::<Result<_>>()?;
        let mut out = vec![vec![DVector::zeros(0); self.segments.len()]; points.len()];
        for (of, all) in [(&simulated, by_engine), (&integrated, by_hand)] {
            for (i, deltas) in all.into_iter().enumerate() {
                out[i % n][of[i / n]] = deltas;
            }
        }
        Ok(out)
    }

    /// Residuals of every group for the given prediction deltas, under each draw of the components.
    fn residuals(&self, deltas: &[DVector<f64>], budget: &dyn Budget) -> Result<Vec<Vec<DVector<f64>>>> {
        let of = |conditional: &ConditionalLikelihood| {
            budget.check()?;
            let mut residuals = conditional.residuals();
            for ((cached, map), deltas) in self.segments.iter().zip(&conditional.maps).zip(deltas) {
                residuals[cached.group] += map * deltas;
            }
            Ok(residuals)
        };
        self.conditionals.iter().map(of).collect()
    }

    /// Applies a function to every point's index and residuals.
    fn map_points<T: Send>(
        &self,
        points: &[ParameterVector],
        budget: &dyn Budget,
        of: impl Fn(usize, &[Vec<DVector<f64>>]) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        let mut out = Vec::with_capacity(points.len());
        for together in points.chunks(POINTS_PER_BATCH) {
            let (first, deltas) = (out.len(), self.prediction_deltas(together, budget)?);
            let one =
                |(i, deltas): (usize, &Vec<DVector<f64>>)| of(first + i, &self.residuals(deltas, budget)?);
            out.extend(deltas.par_iter().enumerate().map(one).collect::<Result<Vec<T>>>()?);
        }
        Ok(out)
    }

    /// Log likelihoods under each draw of the components and each field: `[components][field]`.
    fn conditional_log_likelihoods(
        &self,
        residuals: &[Vec<DVector<f64>>],
        budget: &dyn Budget,
    ) -> Result<Vec<Vec<f64>>> {
        let one = |(conditional, residuals): (&ConditionalLikelihood, &Vec<DVector<f64>>)| {
            budget.check().map(|()| conditional.log_likelihoods(residuals))
        };
        self.conditionals.iter().zip(residuals).map(one).collect()
    }

    /// Posterior of the discrepancy, from draws of the parameters.
    pub fn summarise_discrepancy(
        &self,
        points: &[ParameterVector],
        seed: u64,
        budget: &dyn Budget,
    ) -> Result<DiscrepancySummary> {
        if let Some(sampled_field) = &self.sampled_field {
            let none = DiscrepancyField { over: None, strength: 0.0 };
            let field = sampled_field.summary(points);
            let carried = field.over.map(|over| FieldDraws { over, forces: sampled_field.forces(points) });
            return Ok(DiscrepancySummary {
                fields: vec![(none, 0.0), (field, 1.0)],
                draws: carried.into_iter().collect(),
            });
        }
        let of = |i: usize, residuals: &[Vec<DVector<f64>>]| {
            let under_each = self.conditional_log_likelihoods(residuals, budget)?;
            let mut stream = rng::stream(rng::derive_seed(seed, "draw", i as u64), "field");
            let mixed: Vec<f64> = under_each.iter().map(|of| log_sum_exp(of.iter().copied())).collect();
            let k = sample_categorical(&mixed, &mut stream).unwrap_or(0);
            let drawn = self.conditionals[k].discrepancy.sample(&residuals[k], &under_each[k], &mut stream);
            Ok((marginal(&under_each), drawn))
        };
        let (all, drawn): (Vec<_>, Vec<_>) = self.map_points(points, budget, of)?.into_iter().unzip();
        let carried = (0..self.kinds.len()).filter_map(|kind| self.field_draws(kind, &drawn)).collect();
        let discrepancy = &self.conditionals[0].discrepancy;
        let fields = discrepancy.fields().into_iter().zip(discrepancy.probabilities(&all)).collect();
        Ok(DiscrepancySummary { fields, draws: carried })
    }

    /// Draws of one kind of field, if any.
    fn field_draws(&self, kind: usize, drawn: &[Option<(usize, DVector<f64>)>]) -> Option<FieldDraws> {
        let own = drawn.iter().enumerate().filter_map(|(i, d)| d.as_ref().map(|(k, more)| (i, *k, more)));
        let unnamed = &self.kinds[kind];
        let (draws, amplitudes): (Vec<usize>, Vec<Vec<f64>>) =
            own.filter(|(_, k, _)| *k == kind).map(|(i, _, more)| (i, unnamed.amplitudes(more))).unzip();
        let forces = DiscrepancyForces { effects: unnamed.effect_terms(), draws, amplitudes };
        (!forces.draws.is_empty()).then_some(FieldDraws { over: unnamed.over, forces })
    }
}

fn cache_segments(
    fitter: &ModelFitter,
    fit: &FittedModel,
    linearizations: &[Linearization],
    groups: &[Group],
) -> Result<CachedSegments> {
    let (data, layout, state) = (fitter.data, &fit.layout, &fit.state);
    let mut predictions = model::predict(data, layout, state)?;
    let (mut windows, mut block_indices) = (Vec::new(), Vec::new());
    for (p, part) in groups.iter().enumerate() {
        let mut row = 0;
        for block in &part.blocks {
            data.progress.check_stop()?;
            let w = block.segment;
            let (window, look) = (&data.segments[w], &linearizations[w]);
            let moves = |k: usize| look.jacobian.column(k).amax() > 0.0;
            if !layout.terms.is_empty() || (0..layout.parameters.len()).any(moves) {
                let coordinates = (window, &fitter.coordinates[w]);
                let by_position = groups::observation_jacobian(block, coordinates, look, fitter.scales[w]);
                block_indices.push(BlockIndex { group: p, row, by_position });
                windows.push(CachedSegment {
                    scene: model::apply_initial_state(window, &state.nuisances[w]),
                    segment: window.clone(),
                    nuisances: state.nuisances[w].clone(),
                    mode: state.random_effects.get(w).cloned(),
                    prediction: std::mem::take(&mut predictions[w]),
                    group: p,
                });
            }
            row += block.count();
        }
    }
    Ok((windows, block_indices))
}

impl CachedSegment {
    /// Prediction at the fit minus `predictions`, m.
    fn prediction_delta(&self, predictions: &[f64]) -> DVector<f64> {
        let of = |i: usize, _| self.prediction[i] - predictions.get(i).copied().unwrap_or(f64::NAN);
        DVector::from_fn(self.prediction.len(), of)
    }
}

/// Log likelihoods by field, averaged over draws of the components.
fn marginal(under_each: &[Vec<f64>]) -> Vec<f64> {
    let count = libm::log(under_each.len() as f64);
    let fields = under_each.first().map_or(0, Vec::len);
    (0..fields).map(|f| log_sum_exp(under_each.iter().map(|of| of[f])) - count).collect()
}

impl Target for LogLikelihood {
    fn prior(&self) -> &JointPrior {
        &self.prior
    }

    fn structural_parameters(&self) -> usize {
        if self.sampled_field.is_some() { self.layout.parameters.len() } else { 0 }
    }

    fn log_likelihoods(&self, points: &[ParameterVector], budget: &dyn Budget) -> Result<Vec<f64>> {
        self.map_points(points, budget, |_, residuals| {
            Ok(log_sum_exp(marginal(&self.conditional_log_likelihoods(residuals, budget)?)))
        })
    }
}
