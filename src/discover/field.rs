//! Something nobody named: a force field shared by all launches, as one more rival of every set.
//!
//! Radial functions of position, of velocity and of clock time, each pushing along x and along y, and radial functions of
//! position that push along and across the velocity; integrated twice along the paths of a fitted model, with a ridge
//! prior. Where it predicts launches that it was not fitted to, something that all of them share is left. Its functions are
//! effects of the registry (a test holds one against the other), so that what is left can be simulated: see `bumps`.

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
use crate::world::effect::{Effect, bump, clock_push, place_drive, place_push, velocity_push};

/// Numbers of functions over x and y, vx and vy, and the clock.
const PLACES: [usize; 2] = [8, 5];
const SPEEDS: [usize; 2] = [4, 3];
const TIMES: usize = 16;
/// How many bumps the field is made of, those that push and those that drive.
pub const BUMPS: usize = 2 * PLACES[0] * PLACES[1] + SPEEDS[0] * SPEEDS[1] + TIMES;
/// Standard deviations of coefficients that are tried, m/s^2.
const STRENGTHS: [f64; 4] = [0.2, 0.6, 2.0, 6.0];
/// Directions in the space of coefficients that are kept: those that the data tell most of.
const DIRECTIONS: usize = 64;
/// Times the usual launch's misfit beyond which a launch counts for no more.
const CLIPPED: f64 = 9.0;

/// What a shared field says of a model.
#[derive(Clone, Debug)]
pub struct Shared {
    /// Nats by which the model with the field is better, and the probability that it is.
    pub gain: f64,
    pub probability: f64,
    /// Share of the predictable misfit that the model explains by itself.
    pub explained: f64,
    /// Log densities by launch of the model with the field, spoilt launches spared.
    pub scores: Vec<f64>,
    /// Standard deviation of the field's coefficients by which it predicts best, m/s^2.
    pub strength: f64,
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
    let Some(With { parts, .. }) = with_field(fitter, model)? else { return Ok(None) };
    let Some(own) = components(model, &parts) else { return Ok(None) };
    let alone = spared(&model.score, &base.score);
    let mut best: Option<(Shared, Vec<f64>)> = None;
    let mut tried = |components: &Components| {
        let Some(told) = gaussian::all_told(&parts, components) else { return best.clone() };
        for strength in STRENGTHS {
            let prior = believed(model, components.spread.len(), strength);
            let held_out = score::held_out_with(&parts, &told, &prior, &fitter.folds);
            let Some((scores, squares)) = held_out else { continue };
            let scores = spared(&scores, &base.score);
            let found = compared(&scores, &alone, bootstrap);
            if best.as_ref().is_none_or(|(b, _)| found.worse > b.gain) {
                let (gain, probability) = (found.worse, found.probability);
                let shared = Shared { gain, probability, explained: 1.0, scores, strength };
                best = Some((shared, squares));
            }
        }
        best.clone()
    };
    // First under the model's own components, then under those that launches show beside the field.
    if let Some((first, _)) = tried(&own) {
        let prior = believed(model, own.spread.len(), first.strength);
        if let Some((_, with)) = beside(&parts, &own, &prior) {
            tried(&with);
        }
    }
    let Some((mut found, with)) = best else { return Ok(None) };
    let (none, own) = (&base.squares, &model.squares);
    let most = CLIPPED * median(none);
    let total = |squares: &[f64]| squares.iter().map(|s| s.min(most)).sum::<f64>();
    let (none, own, with) = (total(none), total(own), total(&with));
    // What the field and the model explain together, of which the model's share.
    found.explained = if none > with { ((none - own) / (none - with)).clamp(0.0, 1.0) } else { 0.0 };
    Ok(Some(found))
}

/// The parts of a model with the field's columns, and how those are made of its functions.
struct With {
    parts: Vec<Part>,
    functions: Functions,
    turn: DMatrix<f64>,
}

fn with_field(fitter: &Fitter, model: &Fitted) -> Result<Option<With>> {
    Ok(with_functions(fitter, model)?.map(|(parts, functions)| {
        let (parts, turn) = condensed(parts, model.layout.slots.len());
        With { parts, functions, turn }
    }))
}

/// The parts of a model with a column for each function of the field after those of its slots.
fn with_functions(fitter: &Fitter, model: &Fitted) -> Result<Option<(Vec<Part>, Functions)>> {
    let (layout, state) = (&model.layout, &model.state);
    let paths = model::paths(fitter.data, layout, state)?;
    let functions = Functions::over(fitter.data.windows, &paths);
    let field = |w: usize| match fitter.data.windows[w].kind {
        Kind::Flight | Kind::Contact => Some(functions.columns(&fitter.data.windows[w], &paths[w])),
        _ => None,
    };
    let parts = fitter.parts_with(layout, &model.set, state, functions.count(), &field)?;
    Ok(parts.map(|parts| (parts, functions)))
}

/// Parts whose columns after the first `slots` are turned to the directions that all of them together tell most of: a ridge
/// prior is the same in every direction. And that turn.
fn condensed(mut parts: Vec<Part>, slots: usize) -> (Vec<Part>, DMatrix<f64>) {
    let count = parts.first().map_or(slots, |p| p.blocks[0].columns.ncols()) - slots;
    let mut gram = DMatrix::zeros(count, count);
    for block in parts.iter().flat_map(|p| &p.blocks) {
        let own = block.columns.columns(slots, count);
        gram += own.tr_mul(&own);
    }
    let eigen = gram.symmetric_eigen();
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]).then(a.cmp(b)));
    order.truncate(DIRECTIONS);
    let turn = eigen.eigenvectors.select_columns(&order);
    for block in parts.iter_mut().flat_map(|p| &mut p.blocks) {
        let mut columns = DMatrix::zeros(block.columns.nrows(), slots + turn.ncols());
        columns.columns_mut(0, slots).copy_from(&block.columns.columns(0, slots));
        columns.columns_mut(slots, turn.ncols()).copy_from(&(block.columns.columns(slots, count) * &turn));
        block.columns = columns;
    }
    (parts, turn)
}

/// A model's components beside a field: none of its coefficients differ by launch.
fn components(model: &Fitted, parts: &[Part]) -> Option<Components> {
    let mut components = model.components.clone();
    components.spread.resize(parts.first()?.blocks[0].columns.ncols(), 0.0);
    Some(components)
}

/// What is believed of a model's slots and of a field's coefficients of some strength, `all` of them together.
fn believed(model: &Fitted, all: usize, strength: f64) -> Prior {
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

/// What the field is made of: bumps over places, velocities and times, two functions each; those of places come twice.
struct Functions {
    places: Vec<Bump>,
    speeds: Vec<Bump>,
    times: Vec<Bump>,
}

/// Where a bump stands and how wide it is; the second axis is nothing to the clock.
struct Bump {
    centre: [f64; 2],
    width: [f64; 2],
}

impl Bump {
    fn at(&self, at: [f64; 2]) -> f64 {
        bump([0, 1].map(|a| (at[a] - self.centre[a]) / self.width[a]))
    }
}

impl Functions {
    fn over(windows: &[Window], paths: &[Vec<[f64; 4]>]) -> Functions {
        let flights = || (0..windows.len()).filter(|w| windows[*w].kind == Kind::Flight);
        let all = |k: usize| -> Vec<f64> {
            flights().flat_map(|w| paths[w].iter().map(move |s| s[k])).filter(|v| v.is_finite()).collect()
        };
        let ends = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            let at = |share: f64| {
                values.get((share * (values.len().max(1) - 1) as f64) as usize).copied().unwrap_or(0.0)
            };
            [at(0.02), at(0.98)]
        };
        let clock = flights().flat_map(|w| windows[w].points.iter().map(move |p| windows[w].start + p.time));
        Functions {
            places: grid([ends(all(0)), ends(all(1))], PLACES),
            speeds: grid([ends(all(2)), ends(all(3))], SPEEDS),
            times: grid([ends(clock.collect()), [0.0; 2]], [TIMES, 1]),
        }
    }

    fn count(&self) -> usize {
        2 * (2 * self.places.len() + self.speeds.len() + self.times.len())
    }

    /// Values at a state: each pushes along x and along y, the last along and across the velocity.
    fn pushes(&self, time: f64, [x, y, vx, vy]: [f64; 4]) -> Vec<[f64; 2]> {
        let of = |bumps: &[Bump], at: [f64; 2]| -> Vec<f64> { bumps.iter().map(|b| b.at(at)).collect() };
        let (places, speeds) = (of(&self.places, [x, y]), of(&self.speeds, [vx, vy]));
        let times = of(&self.times, [time, 0.0]);
        let speed = (vx * vx + vy * vy).sqrt().max(1e-9);
        let along =
            places.iter().flat_map(|f| [[f * vx / speed, f * vy / speed], [-f * vy / speed, f * vx / speed]]);
        places.iter().chain(&speeds).chain(&times).flat_map(|f| [[*f, 0.0], [0.0, *f]]).chain(along).collect()
    }

    /// The effects that the functions are, by two, in their order: their first two parameters are the amplitudes.
    fn effects(&self) -> Vec<(&'static Effect, Vec<f64>)> {
        let plane =
            |effect: &'static Effect| move |b: &Bump| (effect, [[0.0; 2], b.centre, b.width].concat());
        let clock = |b: &Bump| (&clock_push::EFFECT, vec![0.0, 0.0, b.centre[0], b.width[0]]);
        let places = self.places.iter().map(plane(&place_push::EFFECT));
        let speeds = self.speeds.iter().map(plane(&velocity_push::EFFECT));
        let drives = self.places.iter().map(plane(&place_drive::EFFECT));
        places.chain(speeds).chain(self.times.iter().map(clock)).chain(drives).collect()
    }

    /// The functions integrated twice along a window's path: two rows a point.
    fn columns(&self, window: &Window, path: &[[f64; 4]]) -> DMatrix<f64> {
        let n = window.points.len();
        let mut out = DMatrix::zeros(2 * n, self.count());
        let mut before: Option<(f64, Vec<[f64; 2]>)> = None;
        let mut moved = vec![[[0.0f64; 2]; 2]; self.count()];
        for (i, (point, state)) in window.points.iter().zip(path).enumerate() {
            let now = self.pushes(window.start + point.time, *state);
            if let Some((time, last)) = before {
                let dt = point.time - time;
                for (k, [place, speed]) in moved.iter_mut().enumerate() {
                    for axis in 0..2 {
                        let a = 0.5 * (last[k][axis] + now[k][axis]);
                        place[axis] += speed[axis] * dt + 0.5 * a * dt * dt;
                        speed[axis] += a * dt;
                        out[(2 * i + axis, k)] = place[axis];
                    }
                }
            }
            before = Some((point.time, now));
        }
        out
    }
}

/// Bumps on a grid between the ends, as wide as it is spaced.
fn grid(ends: [[f64; 2]; 2], counts: [usize; 2]) -> Vec<Bump> {
    let width = [0, 1].map(|a| (ends[a][1] - ends[a][0]) / (counts[a].max(2) - 1) as f64 + 1e-3);
    let at = |i: usize, j: usize| [ends[0][0] + width[0] * i as f64, ends[1][0] + width[1] * j as f64];
    let places = (0..counts[0]).flat_map(|i| (0..counts[1]).map(move |j| (i, j)));
    places.map(|(i, j)| Bump { centre: at(i, j), width }).collect()
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
pub fn said(fitter: &Fitter, model: &Fitted, strength: f64) -> Result<Option<Said>> {
    let Some((parts, functions)) = with_functions(fitter, model)? else { return Ok(None) };
    let said = || {
        let own = components(model, &parts)?;
        let prior = believed(model, own.spread.len(), strength);
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
        Some(Said { gram, score, effects: functions.effects() })
    };
    Ok(said())
}

/// Where launches ask slots and field to go under a model's own components, and the components that they show from there: what a
/// field explains is no slow misfit of each launch.
fn beside(parts: &[Part], own: &Components, prior: &Prior) -> Option<(DVector<f64>, Components)> {
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
pub fn left(fitter: &Fitter, model: &Fitted, strength: f64) -> Result<Option<Left>> {
    let Some(With { parts, functions, turn }) = with_field(fitter, model)? else { return Ok(None) };
    let told = || {
        let components = components(model, &parts)?;
        let prior = believed(model, components.spread.len(), strength);
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

#[cfg(test)]
mod tests {
    use super::*;

    use crate::world::effect::{Act, Moving, Surroundings};

    #[test]
    fn bumps_stand_on_their_grid() {
        let grid = grid([[0.0, 2.0], [1.0, 3.0]], [3, 2]);
        assert_eq!(grid.len(), 6);
        let at: Vec<f64> = grid.iter().map(|b| b.at([1.0, 3.0])).collect();
        let most = at.iter().copied().fold(0.0, f64::max);
        assert_eq!(at.iter().position(|v| *v == most), Some(3));
    }

    /// What is fitted and what is simulated are the same functions.
    #[test]
    fn the_functions_are_those_of_the_effects() {
        let functions = Functions {
            places: grid([[-1.0, 2.0], [0.0, 3.0]], PLACES),
            speeds: grid([[-4.0, 5.0], [-3.0, 2.0]], SPEEDS),
            times: grid([[0.2, 1.4], [0.0; 2]], [TIMES, 1]),
        };
        let (effects, dt) = (functions.effects(), 1e-6);
        assert_eq!(2 * effects.len(), functions.count());
        let around = Surroundings { time_step: dt, gravity: [0.0, -9.81] };
        for (time, [x, y, vx, vy]) in [(0.3, [0.1, 1.2, 2.0, -1.0]), (1.1, [1.7, 2.9, -3.0, 0.5])] {
            for (k, wanted) in functions.pushes(time, [x, y, vx, vy]).into_iter().enumerate() {
                let (effect, mut values) = effects[k / 2].clone();
                values[k % 2] = 1.0;
                let Act::Motion(law) = effect.act else { panic!("{} is no law of motion", effect.name) };
                let body = Moving { time, x, y, vx, vy, omega: 0.0 };
                let kicked = law.kick(&law.constants(&values, &around), body, dt);
                let got = [(kicked[0] - vx) / dt, (kicked[1] - vy) / dt];
                let off = (0..2).map(|a| (got[a] - wanted[a]).abs()).fold(0.0, f64::max);
                assert!(off < 1e-5, "{} {k}: {got:?} for {wanted:?}", effect.name);
            }
        }
    }
}
