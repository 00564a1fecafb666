//! Something nobody named: a force field shared by all launches, as one more rival of every set.
//!
//! Functions of where a body is, how fast it moves and what the clock says (`functions`), integrated twice along the paths of a
//! fitted model, with a ridge prior. Where it predicts launches that it was not fitted to, something that all of them share is
//! left. A field of everything at once pays for what it does not need: of a push by the clock beside a gust all 216 functions predicted
//! launches by 4 nats worse than none, the clock's 32 by 23 better. So fields of one thing each are tried too, and what the choice
//! among them costs is taken off.

mod functions;

use nalgebra::{DMatrix, DVector};

use super::components::{Likelihood, WIDE};
use super::decide::{Bootstrap, TIED, compared};
use super::fit::{Fitted, Fitter};
use super::gaussian::{self, Components, Pooled, Prior, Told};
use super::launch::Part;
use super::model;
use super::score::{self, spared};
use super::stats::median;
use super::window::{Kind, Window};
use crate::error::Result;
use crate::world::effect::Effect;
pub use functions::{BUMPS, Functions, OVERS, Over};

/// Standard deviations of coefficients that are tried, m/s^2.
const STRENGTHS: [f64; 4] = [0.2, 0.6, 2.0, 6.0];
/// Directions in the space of coefficients that are kept: those that the data tell most of.
const DIRECTIONS: usize = 64;
/// Times the usual launch's misfit beyond which a launch counts for no more.
const CLIPPED: f64 = 9.0;

/// What a field depends on, and the standard deviation of its coefficients, m/s^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Form {
    pub over: Over,
    pub strength: f64,
}

/// What a shared field says of a model.
#[derive(Clone, Debug)]
pub struct Shared {
    /// Nats by which the model with the field is better, and the probability that it is.
    pub gain: f64,
    pub probability: f64,
    /// Share of the predictable misfit that the model explains by itself.
    pub explained: f64,
    /// What the model with the field leaves of held-out launches: squares of slow coordinates, in units of the noise.
    pub squares: Vec<f64>,
    /// Log densities by launch of the model with the field, spoilt launches spared, what the choice of field costs taken off.
    pub scores: Vec<f64>,
    /// The field that predicts best.
    pub form: Form,
    /// The field of everything that does: what is to be simulated is chosen among all functions. (Of drives alone, which predicted
    /// best of a ring, rollouts met new launches to 0.54 m, where the formula that stands with it out of all does to less than 0.48.)
    pub whole: Form,
}

impl Shared {
    /// Whether something shared is left for certain.
    pub fn is_left(&self) -> bool {
        self.gain > TIED[0] && self.probability > TIED[1]
    }
}

/// Asks whether `model` leaves something that launches share; `None` without flights or where nothing can be said.
pub fn shared(
    fitter: &Fitter,
    base: &Fitted,
    model: &Fitted,
    bootstrap: &Bootstrap,
) -> Result<Option<Shared>> {
    let windows = fitter.data.windows;
    if !windows.iter().any(|w| w.kind == Kind::Flight) {
        return Ok(None);
    }
    let Some(every) = Every::beside(fitter, model)? else { return Ok(None) };
    let (mut best, mut whole): (Option<Shared>, Option<Form>) = (None, None);
    for over in OVERS {
        let With { parts, .. } = every.of(over);
        let question = Asked { fitter, base, model, bootstrap, parts: &parts, over };
        let Some(found) = question.best() else { continue };
        whole = whole.or((over == Over::All).then_some(found.form));
        if best.as_ref().is_none_or(|b| found.gain > b.gain) {
            best = Some(found);
        }
    }
    Ok(best.map(|found| {
        let whole = whole.unwrap_or(found.form);
        Shared { explained: explained(base, model, &[&found]), whole, ..found }
    }))
}

/// The functions whose sum a field is, where windows lead.
pub fn functions(windows: &[Window], paths: &[Vec<[f64; 4]>]) -> Functions {
    Functions::over(windows, paths)
}

/// Share of what can be predicted of launches that a model explains; predicted by it alone or by one of some fields, whichever
/// leaves less of a launch: a field that meets a launch where no other flew says nothing of what the model leaves of it. (One such
/// launch made a gust explain all of a chirp that it left a tenth of.)
pub fn explained(base: &Fitted, model: &Fitted, fields: &[&Shared]) -> f64 {
    let most = CLIPPED * median(&base.squares);
    let (mut gone, mut all) = (0.0, 0.0);
    for (launch, (none, own)) in base.squares.iter().zip(&model.squares).enumerate() {
        let least = fields.iter().map(|f| f.squares[launch]).fold(*own, f64::min);
        gone += none.min(most) - own.min(most);
        all += none.min(most) - least.min(most);
    }
    if all > 0.0 { (gone / all).clamp(0.0, 1.0) } else { 0.0 }
}

/// A field of one kind beside a model, and what it is asked against.
struct Asked<'a, 'b, 'c> {
    fitter: &'c Fitter<'a, 'b>,
    base: &'c Fitted,
    model: &'c Fitted,
    bootstrap: &'c Bootstrap,
    parts: &'c [Part],
    over: Over,
}

impl Asked<'_, '_, '_> {
    /// The strength that predicts best, under the model's own components or under those that launches show beside the field.
    fn best(&self) -> Option<Shared> {
        let own = components(self.model, self.parts)?;
        let first = self.under(&own)?;
        let prior = believed(self.model, own.spread.len(), first.form.strength);
        let second = beside(self.parts, &own, &prior).and_then(|(_, with)| self.under(&with));
        Some(second.filter(|s| s.gain > first.gain).unwrap_or(first))
    }

    /// The same under components that are given.
    fn under(&self, components: &Components) -> Option<Shared> {
        let told = gaussian::all_told(self.parts, components)?;
        let alone = spared(&self.model.score, &self.base.score);
        let charge = (OVERS.len() as f64).ln() / alone.len() as f64;
        let mut best: Option<Shared> = None;
        for strength in STRENGTHS {
            let prior = believed(self.model, components.spread.len(), strength);
            let held_out = score::held_out_with(self.parts, &told, &prior, &self.fitter.folds);
            let Some((scores, squares)) = held_out else { continue };
            let scores: Vec<f64> =
                spared(&scores, &self.base.score).into_iter().map(|s| s - charge).collect();
            let found = compared(&scores, &alone, self.bootstrap);
            if best.as_ref().is_none_or(|b| found.worse > b.gain) {
                let form = Form { over: self.over, strength };
                let (gain, probability) = (found.worse, found.probability);
                best = Some(Shared { gain, probability, explained: 1.0, squares, scores, form, whole: form });
            }
        }
        best
    }
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
        let parts = fitter.parts_with(layout, &model.set, state, functions.count(), &field)?;
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

/// A model's components beside a field: none of its coefficients differ by launch.
fn components(model: &Fitted, parts: &[Part]) -> Option<Components> {
    let mut components = model.components.clone();
    components.spread.resize(parts.first()?.blocks[0].columns.ncols(), 0.0);
    Some(components)
}

/// What is believed of a model's slots and of a field's coefficients of some strength, `all` of them together.
pub fn believed(model: &Fitted, all: usize, strength: f64) -> Prior {
    let own = &model.prior;
    let q = own.off.len();
    let mut precision = DMatrix::from_diagonal_element(all, all, strength.powi(-2));
    precision.view_mut((0, 0), (q, q)).copy_from(&own.precision);
    let mut prior = Prior { precision, off: DVector::zeros(all), ..own.clone() };
    prior.off.rows_mut(0, q).copy_from(&own.off);
    prior.plausible.resize(all, 0.0);
    prior.reason.resize(all, 0.0);
    prior.by_setting.resize(all, false);
    prior
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
    let said = || {
        let own = components(model, &parts)?;
        let prior = believed(model, own.spread.len(), form.strength);
        let (step, components) = beside(&parts, &own, &prior)?;
        let told = gaussian::all_told(&parts, &components)?;
        let (all, q) = (prior.off.len(), model.layout.slots.len());
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
pub fn beside(parts: &[Part], own: &Components, prior: &Prior) -> Option<(DVector<f64>, Components)> {
    let told = gaussian::all_told(parts, own)?;
    let Pooled { step, .. } = gaussian::pooled(told.iter(), prior)?;
    let mut beside = parts.to_vec();
    for block in beside.iter_mut().flat_map(|p| &mut p.blocks) {
        block.left -= &block.columns * &step;
    }
    let components = Likelihood::new(&beside, own).most(prior, WIDE, |_| true);
    Some((step, components))
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
        let components = components(model, &parts)?;
        let prior = believed(model, components.spread.len(), form.strength);
        let (q, count) = (model.layout.slots.len(), turn.ncols());
        // What the model's sizes could take up is left as long as they stand where they do.
        let only = |t: Told| Told {
            gram: t.gram.view((q, q), (count, count)).into_owned(),
            score: t.score.rows(q, count).into_owned(),
            ..t
        };
        let all: Vec<Told> = gaussian::all_told(&parts, &components)?.into_iter().map(only).collect();
        let precision = prior.precision.view((q, q), (count, count)).into_owned();
        let prior = Prior {
            precision,
            off: DVector::zeros(count),
            plausible: vec![0.0; count],
            reason: vec![0.0; count],
            by_setting: vec![false; count],
        };
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
