//! A window at a state: what is left and how it depends on the slots, in units of the noise, its start projected out.
//!
//! Source: variable projection (Golub and Pereyra 1973), in Kaufman's form.

use nalgebra::{DMatrix, DVector};

use super::data::Data;
use super::engine::{NUDGE, simulated};
use super::layout::Layout;
use super::loss::{share, tamed};
use super::moved::{Moved, Shared, integrated, shared};
use super::state::{Extra, Mode, State};
use crate::discover::path::Impact;
use crate::discover::stats::inverse;
use crate::discover::window::{Kind, Window};
use crate::error::Result;

/// Residuals of runs count in full up to this many noise scales and by their size beyond (Huber 1964).
const HUBER: f64 = 3.0;
/// What a diverged path leaves, in units of the noise: as bad as can be, and it says nothing of where to go.
const DIVERGED: f64 = 1e3;
/// How far nuisances that are no state may plausibly be from where they start: a spin that nobody watched, rad/s; a
/// surface's height, m, and slope.
const SPIN: f64 = 3.0;
const HEIGHT: f64 = 0.01;
const SLOPE: f64 = 0.005;
/// m/s: speed along an axis in which nothing is seen to move.
const STILL: f64 = 0.01;

/// What is left of a window, how it depends on the slots, and on extras.
#[derive(Clone)]
pub struct Look {
    /// Square roots of weights over noise, by point and for each nuisance that is held; 0 for those that do not count.
    pub weights: Vec<f64>,
    pub residual: DVector<f64>,
    /// A column for every slot, then for every extra.
    pub columns: DMatrix<f64>,
    /// Columns of the nuisances.
    pub start: DMatrix<f64>,
    /// Square of the residual; of what went astray, only what grows with its logarithm.
    pub square: f64,
    /// What residual and columns were made smaller by for going astray.
    pub share: f64,
    pub correction: Correction,
    /// What happens in a contact window.
    pub impact: Option<Impact>,
}

/// The step of a window's start that its residual asks for, and by how much less for each step of what its columns are of.
#[derive(Clone)]
pub struct Correction {
    own: DVector<f64>,
    by_column: DMatrix<f64>,
}

impl Correction {
    /// The step that goes with a step of the first columns.
    pub fn step(&self, columns: &DVector<f64>) -> DVector<f64> {
        &self.own - self.by_column.columns(0, columns.len()) * columns
    }
}

/// Every window at a state, its path and derivatives those of its launch's mode; what is left is of launches that are all alike.
/// Where the state has modes, `extras` begin with their pushes.
pub fn looks(data: &Data, layout: &Layout, state: &State, extras: &[Extra]) -> Result<Vec<Look>> {
    let mut simulated = simulated(data, layout, state, extras)?.into_iter();
    let slots = layout.slots.len();
    let look = |w: usize, window: &Window| {
        let nuisances = &state.nuisances[w];
        let shared = shared(layout, &state.values_in(w), window);
        let moved = match window.kind.simulated() {
            true => simulated.next().unwrap_or_default(),
            false => integrated(window, w, layout, state, &shared, extras),
        };
        let mut look = weighed(window, data.sd[w], slots, &shared, nuisances, moved);
        look.project();
        if let Some(mode) = state.modes.get(w) {
            look.even(mode, slots);
        }
        look.tame(window);
        look.square += window.averaged.square / (data.sd[w] * data.sd[w]);
        look
    };
    data.each_window(look)
}

impl Look {
    /// The step of the window's start that goes with a step of the first columns.
    pub fn start_step(&self, step: &DVector<f64>) -> DVector<f64> {
        self.correction.step(step)
    }

    /// What is left of a row, m; NaN where it does not count.
    pub fn metres(&self, row: usize) -> f64 {
        let weight = self.weights[row / 2];
        if weight > 0.0 { self.residual[row] / (self.share * weight) } else { f64::NAN }
    }

    /// The same without any columns, and without what happens in it.
    pub fn bare(&self) -> Look {
        let none = DMatrix::zeros(self.residual.len(), 0);
        Look {
            weights: self.weights.clone(),
            residual: self.residual.clone(),
            columns: none,
            start: self.start.clone(),
            square: self.square,
            share: self.share,
            correction: Correction {
                own: self.correction.own.clone(),
                by_column: DMatrix::zeros(self.start.ncols(), 0),
            },
            impact: None,
        }
    }

    /// With more columns, two rows a point, not yet weighed.
    pub fn with(&self, count: usize, columns: Option<DMatrix<f64>>) -> Look {
        let mut out = self.clone();
        out.append(count, columns);
        out
    }

    /// Adds columns, two rows a point, not yet weighed; nothing where there are none.
    pub fn append(&mut self, count: usize, columns: Option<DMatrix<f64>>) {
        let (rows, before) = self.columns.shape();
        let mut all = DMatrix::zeros(rows, before + count);
        all.columns_mut(0, before).copy_from(&self.columns);
        if let Some(columns) = columns {
            for (i, k) in (0..columns.nrows()).flat_map(|i| (0..count).map(move |k| (i, k))) {
                all[(i, before + k)] = columns[(i, k)] * self.weights[i / 2] * self.share;
            }
        }
        self.columns = all;
    }

    /// Takes what a step of the nuisances can take up out of the residual and the columns.
    fn project(&mut self) {
        if self.start.ncols() > 0 {
            let project = inverse(&self.start.tr_mul(&self.start)) * self.start.transpose();
            let by_column = &project * &self.columns;
            let own = &project * &self.residual;
            self.residual -= &self.start * &own;
            self.correction = Correction { own, by_column: by_column.clone() };
            self.columns -= &self.start * by_column;
        }
        self.square = self.residual.norm_squared();
    }

    /// Gives back what the launch's mode took, as far as its columns tell: what is left is of a launch like all others.
    fn even(&mut self, mode: &Mode, slots: usize) {
        let pushes = mode.pushes.iter().map(|p| p.1);
        let sizes =
            mode.sizes.iter().copied().enumerate().chain(pushes.enumerate().map(|(k, a)| (slots + k, a)));
        for (column, size) in sizes.filter(|(_, size)| *size != 0.0) {
            self.residual.axpy(size, &self.columns.column(column), 1.0);
        }
        self.square = self.residual.norm_squared();
    }

    /// Makes what went astray smaller, as its square counts.
    fn tame(&mut self, window: &Window) {
        let left = 2.0 * window.points.len() as f64 - self.start.ncols() as f64;
        let share = share(self.square, left);
        if window.kind.strays() && share < 1.0 {
            self.share = share;
            self.residual *= share;
            self.columns *= share;
            self.start *= share;
            self.square = tamed(self.square, left);
        }
    }
}

/// Residual and derivatives, weighed. What is held of the nuisances is observed, as it were: two more rows each, of which
/// the second is empty.
fn weighed(
    window: &Window,
    sd: f64,
    slots: usize,
    shared: &[Shared],
    nuisances: &[f64],
    moved: Moved,
) -> Look {
    let held = held(window);
    let (seen, count) = (moved.base.len(), moved.nuisances.len());
    let n = seen + 2 * held.len();
    let off = |i: usize| if i < seen { window.points[i / 2].seen[i % 2] - moved.base[i] } else { 0.0 };
    let mut residual = DVector::from_fn(n, |i, _| off(i));
    let mut weights = weights(window, sd, &residual);
    weights.extend(held.iter().map(|(_, plausible)| 1.0 / plausible));
    let mut start = DMatrix::zeros(n, count);
    let mut columns = DMatrix::zeros(n, slots + moved.extras.len());
    for i in 0..seen {
        let weight = weights[i / 2];
        for (k, slope) in moved.nuisances.iter().enumerate() {
            start[(i, k)] = slope[i] * weight;
        }
        for (s, slope) in shared.iter().zip(&moved.slots) {
            columns[(i, s.slot)] = slope[i] * weight;
        }
        for (k, difference) in moved.extras.iter().enumerate() {
            let d = difference[i] * weight;
            columns[(i, slots + k)] = if d.is_finite() { d } else { 0.0 };
        }
    }
    for (h, (k, _)) in held.iter().enumerate().filter(|(_, (k, _))| *k < count) {
        let row = seen + 2 * h;
        start[(row, *k)] = weights[row / 2];
        residual[row] = if window.kind == Kind::Shot { 0.0 } else { window.nuisances[*k] - nuisances[*k] };
    }
    for i in 0..n {
        residual[i] = if weights[i / 2] > 0.0 { residual[i] * weights[i / 2] } else { 0.0 };
    }
    if !residual.iter().chain(columns.iter()).chain(start.iter()).all(|v| v.is_finite()) {
        residual.fill(DIVERGED);
        columns.fill(0.0);
        start.fill(0.0);
    }
    let correction =
        Correction { own: DVector::zeros(count), by_column: DMatrix::zeros(count, columns.ncols()) };
    Look { weights, residual, columns, start, square: 0.0, share: 1.0, correction, impact: moved.impact }
}

/// Square roots of the weights of a window's points, over the noise.
fn weights(window: &Window, sd: f64, residual: &DVector<f64>) -> Vec<f64> {
    let counts = |i: usize| {
        let size = residual[2 * i].hypot(residual[2 * i + 1]) / sd;
        if window.kind == Kind::Run { HUBER / size.max(HUBER) } else { 1.0 }
    };
    window.points.iter().enumerate().map(|(i, p)| (p.weight * counts(i)).sqrt() / sd).collect()
}

/// Whether nothing is seen to move along an axis.
fn is_still(window: &Window, axis: usize) -> bool {
    window.points.iter().all(|p| p.seen[axis] == window.points[0].seen[axis])
}

/// The nuisances that are no state, which bounces and rolls need besides, and by how much they may plausibly differ from where
/// they start. A shot's spins are held where they stand.
fn held(window: &Window) -> Vec<(usize, f64)> {
    let spin = window.surface.as_ref().map_or(SPIN, |s| s.spin);
    let count = window.nuisances.len();
    let all: Vec<(usize, f64)> = match window.kind {
        Kind::Contact => vec![(4, spin), (5, HEIGHT)],
        Kind::Roll => vec![(2, HEIGHT), (3, SLOPE)],
        // Every body's fifth nuisance.
        Kind::Shot => (4..count).step_by(NUDGE.len()).map(|k| (k, SPIN)).collect(),
        // Along an axis in which nothing is seen to move nothing does: a lift would turn any speed there into a push.
        Kind::Flight => (0..2).filter(|a| is_still(window, *a)).map(|a| (2 + a, STILL)).collect(),
        Kind::Run | Kind::Leap => Vec::new(),
    };
    all.into_iter().filter(|(k, _)| *k < count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{flights, shots, term};
    use crate::task::Scene;
    use crate::world::Engine;

    fn look(windows: &[Window], settings: &[usize], nuisances: Vec<f64>) -> Look {
        let data = Data::new(windows, settings, vec![1e-3], Engine::Lanes);
        let layout = Layout::new(&[], vec![term("wind")], 1);
        let state = State::new(vec![0.0, 0.0], vec![nuisances]);
        looks(&data, &layout, &state, &[]).unwrap().remove(0)
    }

    /// What a wrong start does is gone, and the right one is known; the bend of a wind is left.
    #[test]
    fn what_a_start_takes_up_is_gone() {
        let (windows, settings) = flights([0.0, 0.0], 1);
        let mut wrong = windows[0].nuisances.clone();
        wrong[0] += 0.3;
        wrong[3] -= 2.0;
        let look = look(&windows, &settings, wrong);
        assert!(look.square < 1e-6, "{}", look.square);
        let along = look.start.tr_mul(&look.columns);
        assert!(along.amax() < 1e-6 * look.start.norm() * look.columns.norm(), "{along}");
        assert!(
            look.columns.column(0).norm() > 100.0,
            "a wind of 1 m/s^2 bends by far more than a millimetre"
        );
        let step = look.start_step(&DVector::zeros(2));
        assert!((step[0] + 0.3).abs() < 1e-6 && (step[3] - 2.0).abs() < 1e-6, "{step}");
    }

    /// Of a launch that has a wind of its own, what is left is the wind's: as if the mode had never been.
    #[test]
    fn what_a_mode_takes_is_given_back() {
        let (windows, settings) = flights([0.5, 0.0], 1);
        let data = Data::new(&windows, &settings, vec![1e-3], Engine::Lanes);
        let layout = Layout::new(&[], vec![term("wind")], 1);
        let alike = State::new(vec![0.0, 0.0], vec![windows[0].nuisances.clone()]);
        let mode = Mode { sizes: vec![0.5, 0.0], pushes: Vec::new() };
        let unlike = State { modes: vec![mode], ..alike.clone() };
        let [alike, unlike] = [alike, unlike].map(|s| looks(&data, &layout, &s, &[]).unwrap().remove(0));
        assert!(alike.residual.norm() > 30.0, "{}", alike.residual.norm());
        assert!((&alike.residual - &unlike.residual).norm() < 1e-3 * alike.residual.norm());
        assert!((alike.square - unlike.square).abs() < 1e-3 * alike.square);
    }

    #[test]
    fn a_path_that_diverges_is_bad_and_leads_nowhere() {
        let (windows, settings) = flights([0.0, 0.0], 1);
        let look = look(&windows, &settings, vec![f64::INFINITY; 4]);
        assert!(look.square >= DIVERGED * DIVERGED && look.columns.iter().all(|c| *c == 0.0));
    }

    /// A shot that is off by a metre counts as its logarithm has it; what is left in metres is what it was.
    #[test]
    fn what_goes_astray_is_made_smaller_and_stays_as_far_off() {
        let (mut windows, settings) = shots();
        windows[0].points[3].seen[0] += 1.0;
        let nuisances = windows[0].nuisances.clone();
        let look = look(&windows, &settings, nuisances);
        // 16 coordinates less 10 nuisances, six times what noise leaves of which counts in full.
        let counted = 36.0 * (1.0 - 2.0 * look.share.ln());
        assert!(look.share < 0.05 && (look.square - counted).abs() < 1e-6, "{} {}", look.share, look.square);
        let most = (0..2 * windows[0].points.len()).map(|i| look.metres(i).abs()).fold(0.0, f64::max);
        assert!((0.2..1.0).contains(&most), "{most} m, the start having taken up some of it");
    }

    /// The spins of the first four bodies were once held, and those of further ones left to wander.
    #[test]
    fn the_spin_of_every_body_of_a_shot_is_held() {
        let spins = |bodies: usize| {
            let shot = Window::new(Kind::Shot, Scene::empty(), 0.0, Vec::new());
            let shot = Window { nuisances: vec![0.0; 5 * bodies], ..shot };
            held(&shot).iter().map(|(k, _)| *k).collect::<Vec<_>>()
        };
        assert_eq!(spins(6), [4, 9, 14, 19, 24, 29]);
        assert_eq!(spins(2), [4, 9]);
    }
}
