//! Discrepancy field: a shared force field in addition to a fitted model, without a named effect.
//!
//! Basis functions of position, velocity and time (`basis`), integrated twice along the trajectories of a
//! fitted model, with a ridge prior.

mod basis;

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
use crate::estimate::sampler::log_sum_exp;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::group_statistics::{
    self, GlsEstimate, GroupStatistics, VarianceComponents,
};
use crate::inference::mixed_model::groups::Group;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::mixed_model::variance_components::{ComponentLikelihood, INITIAL_STEP};
use crate::inference::model;
use crate::inference::segment::{Segment, SegmentKind};
use crate::inference::selection::FixedEffectsPrior;
use crate::inference::selection::{Laplace, at_scale};
use crate::progress::Progress;
use crate::world::effect::Effect;
pub use basis::{
    BASIS_FUNCTION_COUNT, FieldBasis, FieldInputs, RADIAL_INPUTS, RadialBasisFunction, radial_grid,
    robust_range,
};

/// Prior standard deviations of the coefficients that are tried, m/s^2.
const COEFFICIENT_SDS: [f64; 4] = [0.2, 0.6, 2.0, 6.0];
/// Maximum number of directions in coefficient space, those with most information.
const MAX_DIRECTIONS: usize = 64;

/// Inputs of a field, and the prior standard deviation of its coefficients, m/s^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldSpec {
    pub inputs: FieldInputs,
    pub coefficient_sd: f64,
}

/// A field fitted in addition to a model.
#[derive(Clone, Copy, Debug)]
pub struct FieldFit {
    pub spec: FieldSpec,
    /// Log evidence, the choice of the form integrated out, nats.
    pub log_evidence: f64,
}

/// The most probable field in addition to a model; `None` without flights or if none can be fitted.
pub fn fit(fitter: &ModelFitter, model: &FittedModel) -> Result<Option<FieldFit>> {
    if !fitter.data.segments.iter().any(|w| w.kind == SegmentKind::Flight) {
        return Ok(None);
    }
    let Some(every) = FieldGroups::new(fitter, model)? else { return Ok(None) };
    let mut best: Option<FieldFit> = None;
    let mut evidences = Vec::new();
    for over in RADIAL_INPUTS {
        fitter.data.progress.check_stop()?;
        let ReducedField { groups, .. } = every.reduced(over, fitter.data.progress)?;
        let statistics =
            group_statistics::group_statistics(&groups, &model.components, fitter.data.progress)?;
        let Some(statistics) = statistics else {
            continue;
        };
        for strength in COEFFICIENT_SDS {
            let Some(Laplace { log_evidence, .. }) = at_scale(&statistics, &model.prior, strength) else {
                continue;
            };
            evidences.push(log_evidence);
            if best.as_ref().is_none_or(|b| log_evidence > b.log_evidence) {
                best = Some(FieldFit {
                    spec: FieldSpec { inputs: over, coefficient_sd: strength },
                    log_evidence,
                });
            }
        }
    }
    let all = log_sum_exp(evidences.iter().copied()) - (evidences.len().max(1) as f64).ln();
    Ok(best.map(|b| FieldFit { log_evidence: all, ..b }))
}

/// Groups of a model with the columns of a field of all inputs, and the mode for coefficients of standard
/// deviation `sd`, m/s^2, without random scales; `None` without flights. `own`: groups of the model with the residuals that
/// the field is fitted to.
pub fn fit_broad(
    fitter: &ModelFitter,
    model: &FittedModel,
    own: &[Group],
    sd: f64,
) -> Result<Option<(Vec<Group>, DVector<f64>)>> {
    if !fitter.data.segments.iter().any(|w| w.kind == SegmentKind::Flight) {
        return Ok(None);
    }
    let Some(every) = FieldGroups::new(fitter, model)? else { return Ok(None) };
    let ReducedField { mut groups, .. } = every.reduced(FieldInputs::All, fitter.data.progress)?;
    let blocks = groups.iter_mut().flat_map(|group| &mut group.blocks);
    for (block, own) in blocks.zip(own.iter().flat_map(|group| &group.blocks)) {
        block.residual.clone_from(&own.residual);
    }
    let components = VarianceComponents { scale: 0.0, ..model.components.clone() };
    let mode = group_statistics::group_statistics(&groups, &components, fitter.data.progress)?
        .and_then(|statistics| at_scale(&statistics, &model.prior, sd));
    Ok(mode.map(|mode| (groups, mode.step)))
}

/// Applies `of` to the groups of a model with the columns of each kind of field after those of its parameters, one kind at a time, since
/// these columns take much memory; empty without flights.
pub fn for_each_inputs<T>(
    fitter: &ModelFitter,
    model: &FittedModel,
    of: impl Fn(&[Group]) -> Result<T>,
) -> Result<Vec<T>> {
    if !fitter.data.segments.iter().any(|w| w.kind == SegmentKind::Flight) {
        return Ok(Vec::new());
    }
    let Some(every) = FieldGroups::new(fitter, model)? else { return Ok(Vec::new()) };
    RADIAL_INPUTS.into_iter().map(|over| of(&every.reduced(over, fitter.data.progress)?.groups)).collect()
}

/// Basis functions of a field along trajectories.
pub fn field_basis(segments: &[Segment], paths: &[Vec<[f64; 4]>]) -> FieldBasis {
    FieldBasis::over(segments, paths)
}

/// Groups of a model with a column for every basis function after those of its parameters.
struct FieldGroups {
    groups: Vec<Group>,
    functions: FieldBasis,
    parameter_count: usize,
}

/// The same for one kind of field in reduced coordinates, with the rotation from these to the basis
/// functions.
struct ReducedField {
    groups: Vec<Group>,
    rotation: DMatrix<f64>,
}

impl FieldGroups {
    fn new(fitter: &ModelFitter, model: &FittedModel) -> Result<Option<FieldGroups>> {
        let (layout, state) = (&model.layout, &model.state);
        let paths = model::segment_states(fitter.data, layout, state)?;
        let functions = FieldBasis::over(fitter.data.segments, &paths);
        let field = |w: usize| {
            let segment = &fitter.data.segments[w];
            match segment.kind {
                SegmentKind::Flight | SegmentKind::Contact => functions.responses(segment, &paths[w]),
                _ => DMatrix::zeros(2 * segment.observations.len(), functions.count()),
            }
        };
        let groups = fitter.groups_with_columns(layout, state, &field)?;
        Ok(groups.map(|groups| FieldGroups { groups, functions, parameter_count: layout.parameters.len() }))
    }

    /// Groups with the columns of one kind of field.
    fn with_inputs(&self, over: FieldInputs) -> Vec<Group> {
        let range = self.functions.indices(over);
        let columns: Vec<usize> =
            (0..self.parameter_count).chain(range.map(|k| self.parameter_count + k)).collect();
        let mut groups = self.groups.clone();
        for block in groups.iter_mut().flat_map(|p| &mut p.blocks) {
            block.jacobian = block.jacobian.select_columns(&columns);
        }
        groups
    }

    /// The same, rotated to the directions with most information over all trials; an isotropic prior is
    /// invariant.
    fn reduced(&self, over: FieldInputs, progress: &dyn Progress) -> Result<ReducedField> {
        let (parameters, range) = (self.parameter_count, self.functions.indices(over));
        let (first, count) = (parameters + range.start, range.len());
        let mut gram = DMatrix::zeros(count, count);
        for block in self.groups.iter().flat_map(|p| &p.blocks) {
            progress.check_stop()?;
            let own = block.jacobian.columns(first, count);
            gram += own.tr_mul(&own);
        }
        let eigen = gram.symmetric_eigen();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]).then(a.cmp(b)));
        order.truncate(MAX_DIRECTIONS);
        let own = eigen.eigenvectors.select_columns(&order);
        let mut groups = self.groups.clone();
        for block in groups.iter_mut().flat_map(|p| &mut p.blocks) {
            progress.check_stop()?;
            let mut columns = DMatrix::zeros(block.jacobian.nrows(), parameters + own.ncols());
            columns.columns_mut(0, parameters).copy_from(&block.jacobian.columns(0, parameters));
            let turned = block.jacobian.columns(first, count) * &own;
            columns.columns_mut(parameters, own.ncols()).copy_from(&turned);
            block.jacobian = columns;
        }
        let mut rotation = DMatrix::zeros(self.functions.count(), own.ncols());
        rotation.rows_mut(range.start, count).copy_from(&own);
        Ok(ReducedField { groups, rotation })
    }
}

/// Normal equations of a field in addition to a model.
pub struct FieldStatistics {
    /// Information matrix and score of the model's parameters (prior included), then of the basis functions.
    pub gram: DMatrix<f64>,
    pub score: DVector<f64>,
    /// The functions as effects, two functions each: their first two parameters are the amplitudes.
    pub effects: Vec<(&'static Effect, Vec<f64>)>,
}

/// Normal equations of a field under the components and weights re-estimated with the field, so that it is
/// not attributed to trial discrepancy; `None` if they cannot be computed.
pub fn field_statistics(
    fitter: &ModelFitter,
    model: &FittedModel,
    form: FieldSpec,
) -> Result<Option<FieldStatistics>> {
    let Some(every) = FieldGroups::new(fitter, model)? else { return Ok(None) };
    let (groups, range) = (every.with_inputs(form.inputs), every.functions.indices(form.inputs));
    let Some(all) = groups.first().map(|p| p.blocks[0].jacobian.ncols()) else { return Ok(None) };
    let prior = model.prior.with_discrepancy(all, form.coefficient_sd);
    let Some((step, components)) =
        refit_components(&groups, &model.components, &prior, fitter.data.progress)?
    else {
        return Ok(None);
    };
    let statistics = group_statistics::group_statistics(&groups, &components, fitter.data.progress)?;
    let said = || {
        let statistics = statistics?;
        let q = model.layout.parameters.len();
        let (mut gram, mut score) = (DMatrix::zeros(all, all), DVector::zeros(all));
        gram.view_mut((0, 0), (q, q)).copy_from(&prior.precision.view((0, 0), (q, q)));
        score.rows_mut(0, q).copy_from(&(&prior.precision * &prior.mean_offset).rows(0, q));
        for t in &statistics {
            let weight = t.weight_after(&step);
            gram += &t.gram * weight;
            score.axpy(weight, &t.score, 1.0);
        }
        let effects = every.functions.effects()[range.start / 2..range.end / 2].to_vec();
        Some(FieldStatistics { gram, score, effects })
    };
    Ok(said())
}

/// Estimates parameters and field under the model's components, and re-estimates the components there.
pub fn refit_components(
    groups: &[Group],
    own: &VarianceComponents,
    prior: &FixedEffectsPrior,
    progress: &dyn Progress,
) -> Result<Option<(DVector<f64>, VarianceComponents)>> {
    let gls = group_statistics::group_statistics(groups, own, progress)?
        .and_then(|statistics| group_statistics::gls(statistics.iter(), prior));
    let Some(GlsEstimate { step, .. }) = gls else { return Ok(None) };
    let mut beside = groups.to_vec();
    for block in beside.iter_mut().flat_map(|p| &mut p.blocks) {
        block.residual -= &block.jacobian * &step;
    }
    let components = ComponentLikelihood::new(&beside, own).maximise(INITIAL_STEP, progress)?;
    Ok(Some((step, components)))
}

/// A field fitted to the residuals of a model.
pub struct FieldEstimate {
    functions: FieldBasis,
    rotation: DMatrix<f64>,
    /// Coefficients with covariance, m/s^2.
    coefficients: GlsEstimate,
}

/// Fits a field in addition to a fixed model; `None` if it cannot be fitted.
pub fn field_estimate(
    fitter: &ModelFitter,
    model: &FittedModel,
    form: FieldSpec,
) -> Result<Option<FieldEstimate>> {
    let Some(every) = FieldGroups::new(fitter, model)? else { return Ok(None) };
    let ReducedField { groups, rotation } = every.reduced(form.inputs, fitter.data.progress)?;
    let functions = every.functions;
    let by_group = group_statistics::group_statistics(&groups, &model.components, fitter.data.progress)?;
    let statistics = || {
        let prior =
            model.prior.with_discrepancy(groups.first()?.blocks[0].jacobian.ncols(), form.coefficient_sd);
        let (q, count) = (model.layout.parameters.len(), rotation.ncols());
        // The model's parameters are fixed.
        let only = |t: GroupStatistics| GroupStatistics {
            gram: t.gram.view((q, q), (count, count)).into_owned(),
            score: t.score.rows(q, count).into_owned(),
            ..t
        };
        let all: Vec<GroupStatistics> = by_group?.into_iter().map(only).collect();
        let precision = prior.precision.view((q, q), (count, count)).into_owned();
        let prior = FixedEffectsPrior { precision, mean_offset: DVector::zeros(count), log_weight: 0.0 };
        group_statistics::gls(all.iter(), &prior)
    };
    Ok(statistics().map(|statistics| FieldEstimate { functions, rotation, coefficients: statistics }))
}

impl FieldEstimate {
    /// Mean acceleration over some states (clock time; x, y, vx, vy) along x and y, and its standard deviation, m/s^2.
    pub fn mean(&self, states: &[(f64, [f64; 4])]) -> [[f64; 2]; 2] {
        let mut rows = [0, 1].map(|_| DVector::zeros(self.functions.count()));
        for (time, state) in states {
            for (k, acceleration) in self.functions.accelerations(*time, *state).iter().enumerate() {
                (0..2).for_each(|axis| rows[axis][k] += acceleration[axis] / states.len() as f64);
            }
        }
        let along = rows.map(|row| self.rotation.tr_mul(&row));
        let sd = |row: &DVector<f64>| row.dot(&(&self.coefficients.covariance * row)).max(0.0).sqrt();
        [[0, 1].map(|axis| along[axis].dot(&self.coefficients.step)), [sd(&along[0]), sd(&along[1])]]
    }
}
