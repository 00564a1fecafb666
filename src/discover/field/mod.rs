//! A force field without a name, shared by all trials, beside a fitted model: what no effect of the library describes.
//!
//! Functions of position, velocity and time (`functions`), integrated twice along the paths of a fitted model, with a ridge prior.

mod functions;

use nalgebra::{DMatrix, DVector};

use super::components::{ComponentLikelihood, INITIAL_STEP};
use super::fit::{FittedModel, ModelFitter};
use super::gaussian::{self, GlsEstimate, GroupStatistics, VarianceComponents};
use super::launch::Group;
use super::model;
use super::selection::FixedEffectsPrior;
use super::selection::{Laplace, at_scale};
use super::window::{Segment, SegmentKind};
use crate::error::Result;
use crate::estimate::sampler::log_sum_exp;
use crate::world::effect::Effect;
pub use functions::{
    BASIS_FUNCTION_COUNT, FieldBasis, FieldInputs, RADIAL_INPUTS, RadialBasisFunction, radial_grid,
    robust_range,
};

/// Standard deviations of coefficients that are tried, m/s^2.
const COEFFICIENT_SDS: [f64; 4] = [0.2, 0.6, 2.0, 6.0];
/// Directions in the space of coefficients that are kept: those that the data tell most of.
const MAX_DIRECTIONS: usize = 64;

/// What a field depends on, and the standard deviation of its coefficients, m/s^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldSpec {
    pub inputs: FieldInputs,
    pub coefficient_sd: f64,
}

/// A field fitted beside a model.
#[derive(Clone, Copy, Debug)]
pub struct FieldFit {
    pub spec: FieldSpec,
    /// Log evidence, the choice of the form integrated out, nats.
    pub log_evidence: f64,
}

/// The most probable field beside a model; `None` without flights or where none can be fitted.
pub fn fit(fitter: &ModelFitter, model: &FittedModel) -> Result<Option<FieldFit>> {
    if !fitter.data.segments.iter().any(|w| w.kind == SegmentKind::Flight) {
        return Ok(None);
    }
    let Some(every) = FieldGroups::new(fitter, model)? else { return Ok(None) };
    let mut best: Option<FieldFit> = None;
    let mut evidences = Vec::new();
    for over in RADIAL_INPUTS {
        let ReducedField { groups: parts, .. } = every.reduced(over);
        let Some(told) = gaussian::group_statistics(&parts, &model.components) else {
            continue;
        };
        for strength in COEFFICIENT_SDS {
            let Some(Laplace { log_evidence, .. }) = at_scale(&told, &model.prior, strength) else {
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

/// The parts of a model with the columns of a field of all inputs, and their mode if the field's standard deviation is `sd`, m/s^2,
/// and no effect's strength differs between trials; `None` without flights.
pub fn fit_broad(
    fitter: &ModelFitter,
    model: &FittedModel,
    sd: f64,
) -> Result<Option<(Vec<Group>, DVector<f64>)>> {
    if !fitter.data.segments.iter().any(|w| w.kind == SegmentKind::Flight) {
        return Ok(None);
    }
    let Some(every) = FieldGroups::new(fitter, model)? else { return Ok(None) };
    let ReducedField { groups: parts, .. } = every.reduced(FieldInputs::All);
    let components = VarianceComponents { scale: 0.0, ..model.components.clone() };
    let mode =
        gaussian::group_statistics(&parts, &components).and_then(|told| at_scale(&told, &model.prior, sd));
    Ok(mode.map(|mode| (parts, mode.step)))
}

/// The parts of a model with the columns of each kind of field after those of its slots; none without flights.
pub fn groups_by_inputs(fitter: &ModelFitter, model: &FittedModel) -> Result<Vec<Vec<Group>>> {
    if !fitter.data.segments.iter().any(|w| w.kind == SegmentKind::Flight) {
        return Ok(Vec::new());
    }
    let Some(every) = FieldGroups::new(fitter, model)? else { return Ok(Vec::new()) };
    Ok(RADIAL_INPUTS.into_iter().map(|over| every.reduced(over).groups).collect())
}

/// The functions whose sum a field is, where windows lead.
pub fn field_basis(windows: &[Segment], paths: &[Vec<[f64; 4]>]) -> FieldBasis {
    FieldBasis::over(windows, paths)
}

/// The parts of a model with a column for each function of every field after those of its slots.
struct FieldGroups {
    groups: Vec<Group>,
    functions: FieldBasis,
    parameter_count: usize,
}

/// The same with the columns of one field, and how those are made of the functions.
struct ReducedField {
    groups: Vec<Group>,
    rotation: DMatrix<f64>,
}

impl FieldGroups {
    fn new(fitter: &ModelFitter, model: &FittedModel) -> Result<Option<FieldGroups>> {
        let (layout, state) = (&model.layout, &model.state);
        let paths = model::segment_states(fitter.data, layout, state)?;
        let functions = FieldBasis::over(fitter.data.segments, &paths);
        let field = |w: usize| match fitter.data.segments[w].kind {
            SegmentKind::Flight | SegmentKind::Contact => {
                Some(functions.responses(&fitter.data.segments[w], &paths[w]))
            }
            _ => None,
        };
        let parts = fitter.groups_with_columns(layout, state, functions.count(), &field)?;
        Ok(parts.map(|parts| FieldGroups {
            groups: parts,
            functions,
            parameter_count: layout.parameters.len(),
        }))
    }

    /// Parts with the columns of one field as they are.
    fn with_inputs(&self, over: FieldInputs) -> Vec<Group> {
        let range = self.functions.indices(over);
        let columns: Vec<usize> =
            (0..self.parameter_count).chain(range.map(|k| self.parameter_count + k)).collect();
        let mut parts = self.groups.clone();
        for block in parts.iter_mut().flat_map(|p| &mut p.blocks) {
            block.jacobian = block.jacobian.select_columns(&columns);
        }
        parts
    }

    /// Those columns of a field turned to the directions that all launches together tell most of: a ridge prior is the same in
    /// every direction.
    fn reduced(&self, over: FieldInputs) -> ReducedField {
        let (slots, range) = (self.parameter_count, self.functions.indices(over));
        let (first, count) = (slots + range.start, range.len());
        let mut gram = DMatrix::zeros(count, count);
        for block in self.groups.iter().flat_map(|p| &p.blocks) {
            let own = block.jacobian.columns(first, count);
            gram += own.tr_mul(&own);
        }
        let eigen = gram.symmetric_eigen();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]).then(a.cmp(b)));
        order.truncate(MAX_DIRECTIONS);
        let own = eigen.eigenvectors.select_columns(&order);
        let mut parts = self.groups.clone();
        for block in parts.iter_mut().flat_map(|p| &mut p.blocks) {
            let mut columns = DMatrix::zeros(block.jacobian.nrows(), slots + own.ncols());
            columns.columns_mut(0, slots).copy_from(&block.jacobian.columns(0, slots));
            let turned = block.jacobian.columns(first, count) * &own;
            columns.columns_mut(slots, own.ncols()).copy_from(&turned);
            block.jacobian = columns;
        }
        let mut turn = DMatrix::zeros(self.functions.count(), own.ncols());
        turn.rows_mut(range.start, count).copy_from(&own);
        ReducedField { groups: parts, rotation: turn }
    }
}

/// What all launches together say of the field's functions beside a model.
pub struct FieldStatistics {
    /// Information of the model's slots, with what is believed of them, then of the functions; and what goes with it.
    pub gram: DMatrix<f64>,
    pub score: DVector<f64>,
    /// The effects that the functions are, two functions each: their first two parameters are the amplitudes.
    pub effects: Vec<(&'static Effect, Vec<f64>)>,
}

/// What launches say of the functions of a field of some strength, under the components and weights that they have beside the
/// whole field: what it explains is no slow misfit of each launch. (Under the model's own components a swirl that 14 launches
/// show was three bumps, under these it is six, and rollouts miss new launches by 0.19 m in place of 0.38.) `None` where that
/// cannot be told.
pub fn field_statistics(
    fitter: &ModelFitter,
    model: &FittedModel,
    form: FieldSpec,
) -> Result<Option<FieldStatistics>> {
    let Some(every) = FieldGroups::new(fitter, model)? else { return Ok(None) };
    let (parts, range) = (every.with_inputs(form.inputs), every.functions.indices(form.inputs));
    let said = || {
        let all = parts.first()?.blocks[0].jacobian.ncols();
        let prior = model.prior.with_discrepancy(all, form.coefficient_sd);
        let (step, components) = refit_components(&parts, &model.components, &prior)?;
        let told = gaussian::group_statistics(&parts, &components)?;
        let q = model.layout.parameters.len();
        let (mut gram, mut score) = (DMatrix::zeros(all, all), DVector::zeros(all));
        gram.view_mut((0, 0), (q, q)).copy_from(&prior.precision.view((0, 0), (q, q)));
        score.rows_mut(0, q).copy_from(&(&prior.precision * &prior.mean_offset).rows(0, q));
        for t in &told {
            let weight = t.weight_after(&step);
            gram += &t.gram * weight;
            score.axpy(weight, &t.score, 1.0);
        }
        let effects = every.functions.effects()[range.start / 2..range.end / 2].to_vec();
        Some(FieldStatistics { gram, score, effects })
    };
    Ok(said())
}

/// Where launches ask slots and field to go under a model's own components, and the components that they show from there: what a
/// field explains is no slow misfit of each launch.
pub fn refit_components(
    parts: &[Group],
    own: &VarianceComponents,
    prior: &FixedEffectsPrior,
) -> Option<(DVector<f64>, VarianceComponents)> {
    let told = gaussian::group_statistics(parts, own)?;
    let GlsEstimate { step, .. } = gaussian::gls(told.iter(), prior)?;
    let mut beside = parts.to_vec();
    for block in beside.iter_mut().flat_map(|p| &mut p.blocks) {
        block.residual -= &block.jacobian * &step;
    }
    let components = ComponentLikelihood::new(&beside, own).maximise(INITIAL_STEP);
    Some((step, components))
}

/// A field fitted to what a model leaves of all launches.
pub struct FieldEstimate {
    functions: FieldBasis,
    rotation: DMatrix<f64>,
    /// Coefficients, m/s^2, and their covariance.
    coefficients: GlsEstimate,
}

/// The field of some strength beside a model as it stands; `None` where it cannot be fitted.
pub fn field_estimate(
    fitter: &ModelFitter,
    model: &FittedModel,
    form: FieldSpec,
) -> Result<Option<FieldEstimate>> {
    let Some(every) = FieldGroups::new(fitter, model)? else { return Ok(None) };
    let ReducedField { groups: parts, rotation: turn } = every.reduced(form.inputs);
    let functions = every.functions;
    let told = || {
        let prior =
            model.prior.with_discrepancy(parts.first()?.blocks[0].jacobian.ncols(), form.coefficient_sd);
        let (q, count) = (model.layout.parameters.len(), turn.ncols());
        // What the model's sizes could take up is left as long as they stand where they do.
        let only = |t: GroupStatistics| GroupStatistics {
            gram: t.gram.view((q, q), (count, count)).into_owned(),
            score: t.score.rows(q, count).into_owned(),
            ..t
        };
        let all: Vec<GroupStatistics> =
            gaussian::group_statistics(&parts, &model.components)?.into_iter().map(only).collect();
        let precision = prior.precision.view((q, q), (count, count)).into_owned();
        let prior = FixedEffectsPrior { precision, mean_offset: DVector::zeros(count), log_weight: 0.0 };
        gaussian::gls(all.iter(), &prior)
    };
    Ok(told().map(|told| FieldEstimate { functions, rotation: turn, coefficients: told }))
}

impl FieldEstimate {
    /// Mean acceleration over some states (clock time; x, y, vx, vy) along x and y, and its standard deviation, m/s^2.
    pub fn mean(&self, states: &[(f64, [f64; 4])]) -> [[f64; 2]; 2] {
        let mut rows = [0, 1].map(|_| DVector::zeros(self.functions.count()));
        for (time, state) in states {
            for (k, push) in self.functions.accelerations(*time, *state).iter().enumerate() {
                (0..2).for_each(|axis| rows[axis][k] += push[axis] / states.len() as f64);
            }
        }
        let along = rows.map(|row| self.rotation.tr_mul(&row));
        let sd = |row: &DVector<f64>| row.dot(&(&self.coefficients.covariance * row)).max(0.0).sqrt();
        [[0, 1].map(|axis| along[axis].dot(&self.coefficients.step)), [sd(&along[0]), sd(&along[1])]]
    }
}
