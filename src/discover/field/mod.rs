//! A force field without a name, shared by all trials, beside a fitted model: what no effect of the library describes.
//!
//! Functions of position, velocity and time (`functions`), integrated twice along the paths of a fitted model, with a ridge prior.

mod functions;

use nalgebra::{DMatrix, DVector};

use super::components::{Likelihood, WIDE};
use super::fit::{Fitted, Fitter};
use super::gaussian::{self, Components, Pooled, Told};
use super::launch::Part;
use super::model;
use super::selection::Prior;
use super::selection::{Laplace, at_scale};
use super::window::{Kind, Window};
use crate::error::Result;
use crate::estimate::sampler::log_sum_exp;
use crate::progress::Progress;
use crate::world::effect::Effect;
pub use functions::{BUMPS, Bump, Functions, OVERS, Over, ends, grid};

/// Standard deviations of coefficients that are tried, m/s^2.
const STRENGTHS: [f64; 4] = [0.2, 0.6, 2.0, 6.0];
/// Directions in the space of coefficients that are kept: those that the data tell most of.
const DIRECTIONS: usize = 64;

/// What a field depends on, and the standard deviation of its coefficients, m/s^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Form {
    pub over: Over,
    pub strength: f64,
}

/// A field fitted beside a model.
#[derive(Clone, Copy, Debug)]
pub struct FieldFit {
    pub form: Form,
    /// Log evidence, the choice of the form integrated out, nats.
    pub log_evidence: f64,
}

/// The most probable field beside a model; `None` without flights or where none can be fitted.
pub fn fit(fitter: &Fitter, model: &Fitted) -> Result<Option<FieldFit>> {
    if !fitter.data.windows.iter().any(|w| w.kind == Kind::Flight) {
        return Ok(None);
    }
    let Some(every) = Every::beside(fitter, model)? else { return Ok(None) };
    let mut best: Option<FieldFit> = None;
    let mut evidences = Vec::new();
    for over in OVERS {
        fitter.data.progress.check_stop()?;
        let With { parts, .. } = every.of(over);
        let Some(told) = gaussian::all_told(&parts, &model.components) else {
            continue;
        };
        for strength in STRENGTHS {
            let Some(Laplace { log_evidence, .. }) = at_scale(&told, &model.prior, strength) else {
                continue;
            };
            evidences.push(log_evidence);
            if best.as_ref().is_none_or(|b| log_evidence > b.log_evidence) {
                best = Some(FieldFit { form: Form { over, strength }, log_evidence });
            }
        }
    }
    let all = log_sum_exp(evidences.iter().copied()) - (evidences.len().max(1) as f64).ln();
    Ok(best.map(|b| FieldFit { log_evidence: all, ..b }))
}

/// The parts of a model with the columns of a field of all inputs, and their mode if the field's standard deviation is `sd`, m/s^2,
/// and no effect's strength differs between trials; `None` without flights.
pub fn broad(fitter: &Fitter, model: &Fitted, sd: f64) -> Result<Option<(Vec<Part>, DVector<f64>)>> {
    if !fitter.data.windows.iter().any(|w| w.kind == Kind::Flight) {
        return Ok(None);
    }
    let Some(every) = Every::beside(fitter, model)? else { return Ok(None) };
    let With { parts, .. } = every.of(Over::All);
    let components = Components { strength: 0.0, ..model.components.clone() };
    let mode = gaussian::all_told(&parts, &components).and_then(|told| at_scale(&told, &model.prior, sd));
    Ok(mode.map(|mode| (parts, mode.step)))
}

/// The parts of a model with the columns of each kind of field after those of its slots; none without flights.
pub fn kinds(fitter: &Fitter, model: &Fitted) -> Result<Vec<Vec<Part>>> {
    if !fitter.data.windows.iter().any(|w| w.kind == Kind::Flight) {
        return Ok(Vec::new());
    }
    let Some(every) = Every::beside(fitter, model)? else { return Ok(Vec::new()) };
    Ok(OVERS.into_iter().map(|over| every.of(over).parts).collect())
}

/// The functions whose sum a field is, where windows lead.
pub fn functions(windows: &[Window], paths: &[Vec<[f64; 4]>]) -> Functions {
    Functions::over(windows, paths)
}

/// The parts of a model with a column for each function of every field after those of its slots.
struct Every {
    parts: Vec<Part>,
    functions: Functions,
    slots: usize,
}

/// The same with the columns of one field, and how those are made of the functions.
struct With {
    parts: Vec<Part>,
    turn: DMatrix<f64>,
}

impl Every {
    fn beside(fitter: &Fitter, model: &Fitted) -> Result<Option<Every>> {
        let (layout, state) = (&model.layout, &model.state);
        let paths = model::paths(fitter.data, layout, state)?;
        let functions = Functions::over(fitter.data.windows, &paths);
        let field = |w: usize| match fitter.data.windows[w].kind {
            Kind::Flight | Kind::Contact => Some(functions.columns(&fitter.data.windows[w], &paths[w])),
            _ => None,
        };
        let parts = fitter.parts_with(layout, state, functions.count(), &field)?;
        Ok(parts.map(|parts| Every { parts, functions, slots: layout.slots.len() }))
    }

    /// Parts with the columns of one field as they are.
    fn only(&self, over: Over) -> Vec<Part> {
        let range = self.functions.range(over);
        let columns: Vec<usize> = (0..self.slots).chain(range.map(|k| self.slots + k)).collect();
        let mut parts = self.parts.clone();
        for block in parts.iter_mut().flat_map(|p| &mut p.blocks) {
            block.columns = block.columns.select_columns(&columns);
        }
        parts
    }

    /// Those columns of a field turned to the directions that all launches together tell most of: a ridge prior is the same in
    /// every direction.
    fn of(&self, over: Over) -> With {
        let (slots, range) = (self.slots, self.functions.range(over));
        let (first, count) = (slots + range.start, range.len());
        let mut gram = DMatrix::zeros(count, count);
        for block in self.parts.iter().flat_map(|p| &p.blocks) {
            let own = block.columns.columns(first, count);
            gram += own.tr_mul(&own);
        }
        let eigen = gram.symmetric_eigen();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]).then(a.cmp(b)));
        order.truncate(DIRECTIONS);
        let own = eigen.eigenvectors.select_columns(&order);
        let mut parts = self.parts.clone();
        for block in parts.iter_mut().flat_map(|p| &mut p.blocks) {
            let mut columns = DMatrix::zeros(block.columns.nrows(), slots + own.ncols());
            columns.columns_mut(0, slots).copy_from(&block.columns.columns(0, slots));
            let turned = block.columns.columns(first, count) * &own;
            columns.columns_mut(slots, own.ncols()).copy_from(&turned);
            block.columns = columns;
        }
        let mut turn = DMatrix::zeros(self.functions.count(), own.ncols());
        turn.rows_mut(range.start, count).copy_from(&own);
        With { parts, turn }
    }
}

/// What all launches together say of the field's functions beside a model.
pub struct Said {
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
pub fn said(fitter: &Fitter, model: &Fitted, form: Form) -> Result<Option<Said>> {
    let Some(every) = Every::beside(fitter, model)? else { return Ok(None) };
    let (parts, range) = (every.only(form.over), every.functions.range(form.over));
    let Some(all) = parts.first().map(|p| p.blocks[0].columns.ncols()) else { return Ok(None) };
    let prior = model.prior.with_discrepancy(all, form.strength);
    let Some((step, components)) = beside(&parts, &model.components, &prior, fitter.data.progress)? else {
        return Ok(None);
    };
    let said = || {
        let told = gaussian::all_told(&parts, &components)?;
        let q = model.layout.slots.len();
        let (mut gram, mut score) = (DMatrix::zeros(all, all), DVector::zeros(all));
        gram.view_mut((0, 0), (q, q)).copy_from(&prior.precision.view((0, 0), (q, q)));
        score.rows_mut(0, q).copy_from(&(&prior.precision * &prior.off).rows(0, q));
        for t in &told {
            let weight = t.weight(&step);
            gram += &t.gram * weight;
            score.axpy(weight, &t.score, 1.0);
        }
        let effects = every.functions.effects()[range.start / 2..range.end / 2].to_vec();
        Some(Said { gram, score, effects })
    };
    Ok(said())
}

/// Where launches ask slots and field to go under a model's own components, and the components that they show from there: what a
/// field explains is no slow misfit of each launch.
pub fn beside(
    parts: &[Part],
    own: &Components,
    prior: &Prior,
    progress: &dyn Progress,
) -> Result<Option<(DVector<f64>, Components)>> {
    let pooled = gaussian::all_told(parts, own).and_then(|told| gaussian::pooled(told.iter(), prior));
    let Some(Pooled { step, .. }) = pooled else { return Ok(None) };
    let mut beside = parts.to_vec();
    for block in beside.iter_mut().flat_map(|p| &mut p.blocks) {
        block.left -= &block.columns * &step;
    }
    let components = Likelihood::new(&beside, own).most(WIDE, progress)?;
    Ok(Some((step, components)))
}

/// A field fitted to what a model leaves of all launches.
pub struct Left {
    functions: Functions,
    turn: DMatrix<f64>,
    /// Coefficients, m/s^2, and their covariance.
    told: Pooled,
}

/// The field of some strength beside a model as it stands; `None` where it cannot be fitted.
pub fn left(fitter: &Fitter, model: &Fitted, form: Form) -> Result<Option<Left>> {
    let Some(every) = Every::beside(fitter, model)? else { return Ok(None) };
    let With { parts, turn } = every.of(form.over);
    let functions = every.functions;
    let told = || {
        let prior = model.prior.with_discrepancy(parts.first()?.blocks[0].columns.ncols(), form.strength);
        let (q, count) = (model.layout.slots.len(), turn.ncols());
        // What the model's sizes could take up is left as long as they stand where they do.
        let only = |t: Told| Told {
            gram: t.gram.view((q, q), (count, count)).into_owned(),
            score: t.score.rows(q, count).into_owned(),
            ..t
        };
        let all: Vec<Told> = gaussian::all_told(&parts, &model.components)?.into_iter().map(only).collect();
        let precision = prior.precision.view((q, q), (count, count)).into_owned();
        let prior = Prior { precision, off: DVector::zeros(count), log_weight: 0.0 };
        gaussian::pooled(all.iter(), &prior)
    };
    Ok(told().map(|told| Left { functions, turn, told }))
}

impl Left {
    /// Mean acceleration over some states (clock time; x, y, vx, vy) along x and y, and its standard deviation, m/s^2.
    pub fn mean(&self, states: &[(f64, [f64; 4])]) -> [[f64; 2]; 2] {
        let mut rows = [0, 1].map(|_| DVector::zeros(self.functions.count()));
        for (time, state) in states {
            for (k, push) in self.functions.pushes(*time, *state).iter().enumerate() {
                (0..2).for_each(|axis| rows[axis][k] += push[axis] / states.len() as f64);
            }
        }
        let along = rows.map(|row| self.turn.tr_mul(&row));
        let sd = |row: &DVector<f64>| row.dot(&(&self.told.covariance * row)).max(0.0).sqrt();
        [[0, 1].map(|axis| along[axis].dot(&self.told.step)), [sd(&along[0]), sd(&along[1])]]
    }
}
