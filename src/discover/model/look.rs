//! A window at a state: what is left and how it depends on the slots, in units of the noise, its start projected out.
//!
//! Source: variable projection (Golub and Pereyra 1973), in Kaufman's form.

use nalgebra::{DMatrix, DVector};

use super::data::SegmentData;
use super::engine::{STATE_FD_STEPS, linearise_engine};
use super::layout::ParameterLayout;
use super::loss::{irls_scale, robust_square};
use super::moved::{Prediction, Stencil, linearise_ode, stencils};
use super::state::{FitState, Perturbation, RandomEffects};
use crate::discover::path::Impact;
use crate::discover::stats::pseudo_inverse;
use crate::discover::window::{Segment, SegmentKind};
use crate::error::Result;

/// Residuals of runs count in full up to this many noise scales and by their size beyond (Huber 1964).
const HUBER_LIMIT: f64 = 3.0;
/// What a diverged path leaves, in units of the noise: as bad as can be, and it says nothing of where to go.
const DIVERGED_RESIDUAL: f64 = 1e3;
/// How far nuisances that are no state may plausibly be from where they start: a spin that nobody watched, rad/s; a
/// surface's height, m, and slope.
const SPIN_SD: f64 = 3.0;
const HEIGHT_SD: f64 = 0.01;
const SLOPE_SD: f64 = 0.005;
/// m/s: speed along an axis in which nothing is seen to move.
const STATIONARY_SPEED_SD: f64 = 0.01;

/// What is left of a window, how it depends on the slots, and on extras.
#[derive(Clone)]
pub struct Linearization {
    /// Square roots of weights over noise, by point and for each nuisance that is held; 0 for those that do not count.
    pub weights: Vec<f64>,
    pub residual: DVector<f64>,
    /// A column for every slot, then for every extra.
    pub jacobian: DMatrix<f64>,
    /// Columns of the nuisances.
    pub nuisance_jacobian: DMatrix<f64>,
    /// Square of the residual; of what went astray, only what grows with its logarithm.
    pub square: f64,
    /// What residual and columns were made smaller by for going astray.
    pub irls_scale: f64,
    pub nuisance_update: NuisanceUpdate,
    /// What happens in a contact window.
    pub impact: Option<Impact>,
}

/// The step of a window's start that its residual asks for, and by how much less for each step of what its columns are of.
#[derive(Clone)]
pub struct NuisanceUpdate {
    step_at_fixed_parameters: DVector<f64>,
    by_parameter: DMatrix<f64>,
}

impl NuisanceUpdate {
    /// The step that goes with a step of the first columns.
    pub fn step(&self, columns: &DVector<f64>) -> DVector<f64> {
        &self.step_at_fixed_parameters - self.by_parameter.columns(0, columns.len()) * columns
    }
}

/// Every window at a state, its path and derivatives those of its launch's mode; what is left is of launches that are all alike.
/// Where the state has modes, `extras` begin with their pushes.
pub fn linearise(
    data: &SegmentData,
    layout: &ParameterLayout,
    state: &FitState,
    extras: &[Perturbation],
) -> Result<Vec<Linearization>> {
    let mut simulated = linearise_engine(data, layout, state, extras)?.into_iter();
    let slots = layout.parameters.len();
    let look = |(w, window): (usize, &Segment)| {
        let nuisances = &state.nuisances[w];
        let shared = stencils(layout, &state.values_in(w), window);
        let moved = match window.kind.uses_engine() {
            true => simulated.next().unwrap_or_default(),
            false => linearise_ode(window, w, layout, state, &shared, extras),
        };
        let mut look = whiten(window, data.sd[w], slots, &shared, nuisances, moved);
        look.project_out_nuisances();
        if let Some(mode) = state.random_effects.get(w) {
            look.restore_random_effects(mode, slots);
        }
        look.apply_robust_loss(window);
        look
    };
    Ok(data.segments.iter().enumerate().map(look).collect())
}

impl Linearization {
    /// The step of the window's start that goes with a step of the first columns.
    pub fn nuisance_step(&self, step: &DVector<f64>) -> DVector<f64> {
        self.nuisance_update.step(step)
    }

    /// What is left of a row, m; NaN where it does not count.
    pub fn residual_metres(&self, row: usize) -> f64 {
        let weight = self.weights[row / 2];
        if weight > 0.0 { self.residual[row] / (self.irls_scale * weight) } else { f64::NAN }
    }

    /// The same without any columns, and without what happens in it.
    pub fn without_jacobian(&self) -> Linearization {
        let none = DMatrix::zeros(self.residual.len(), 0);
        Linearization {
            weights: self.weights.clone(),
            residual: self.residual.clone(),
            jacobian: none,
            nuisance_jacobian: self.nuisance_jacobian.clone(),
            square: self.square,
            irls_scale: self.irls_scale,
            nuisance_update: NuisanceUpdate {
                step_at_fixed_parameters: self.nuisance_update.step_at_fixed_parameters.clone(),
                by_parameter: DMatrix::zeros(self.nuisance_jacobian.ncols(), 0),
            },
            impact: None,
        }
    }

    /// With more columns, two rows a point, not yet weighed.
    pub fn with_columns(&self, count: usize, columns: &DMatrix<f64>) -> Linearization {
        let mut out = self.clone();
        out.append_columns(count, Some(columns.clone()));
        out
    }

    /// Adds columns, two rows a point, not yet weighed; nothing where there are none.
    pub fn append_columns(&mut self, count: usize, columns: Option<DMatrix<f64>>) {
        let (rows, before) = self.jacobian.shape();
        let mut all = DMatrix::zeros(rows, before + count);
        all.columns_mut(0, before).copy_from(&self.jacobian);
        if let Some(columns) = columns {
            for (i, k) in (0..columns.nrows()).flat_map(|i| (0..count).map(move |k| (i, k))) {
                all[(i, before + k)] = columns[(i, k)] * self.weights[i / 2] * self.irls_scale;
            }
        }
        self.jacobian = all;
    }

    /// Takes what a step of the nuisances can take up out of the residual and the columns.
    fn project_out_nuisances(&mut self) {
        if self.nuisance_jacobian.ncols() > 0 {
            let project = pseudo_inverse(&self.nuisance_jacobian.tr_mul(&self.nuisance_jacobian))
                * self.nuisance_jacobian.transpose();
            let by_column = &project * &self.jacobian;
            let own = &project * &self.residual;
            self.residual -= &self.nuisance_jacobian * &own;
            self.nuisance_update =
                NuisanceUpdate { step_at_fixed_parameters: own, by_parameter: by_column.clone() };
            self.jacobian -= &self.nuisance_jacobian * by_column;
        }
        self.square = self.residual.norm_squared();
    }

    /// Gives back what the launch's mode took, as far as its columns tell: what is left is of a launch like all others.
    fn restore_random_effects(&mut self, mode: &RandomEffects, slots: usize) {
        let pushes = mode.accelerations.iter().map(|p| p.1);
        let sizes = mode
            .deviations
            .iter()
            .copied()
            .enumerate()
            .chain(pushes.enumerate().map(|(k, a)| (slots + k, a)));
        for (column, size) in sizes.filter(|(_, size)| *size != 0.0) {
            self.residual.axpy(size, &self.jacobian.column(column), 1.0);
        }
        self.square = self.residual.norm_squared();
    }

    /// Makes what went astray smaller, as its square counts.
    fn apply_robust_loss(&mut self, window: &Segment) {
        let left = 2.0 * window.observations.len() as f64 - self.nuisance_jacobian.ncols() as f64;
        let share = irls_scale(self.square, left);
        if window.kind.is_chaotic() && share < 1.0 {
            self.irls_scale = share;
            self.residual *= share;
            self.jacobian *= share;
            self.nuisance_jacobian *= share;
            self.square = robust_square(self.square, left);
        }
    }
}

/// Residual and derivatives, weighed. What is held of the nuisances is observed, as it were: two more rows each, of which
/// the second is empty.
fn whiten(
    window: &Segment,
    sd: f64,
    slots: usize,
    shared: &[Stencil],
    nuisances: &[f64],
    moved: Prediction,
) -> Linearization {
    let held = regularised_nuisances(window);
    let (seen, count) = (moved.positions.len(), moved.by_nuisance.len());
    let n = seen + 2 * held.len();
    let off = |i: usize| {
        if i < seen { window.observations[i / 2].position[i % 2] - moved.positions[i] } else { 0.0 }
    };
    let mut residual = DVector::from_fn(n, |i, _| off(i));
    let mut weights = observation_weights(window, sd, &residual);
    weights.extend(held.iter().map(|(_, plausible)| 1.0 / plausible));
    let mut start = DMatrix::zeros(n, count);
    let mut columns = DMatrix::zeros(n, slots + moved.by_perturbation.len());
    for i in 0..seen {
        let weight = weights[i / 2];
        for (k, slope) in moved.by_nuisance.iter().enumerate() {
            start[(i, k)] = slope[i] * weight;
        }
        for (s, slope) in shared.iter().zip(&moved.by_parameter) {
            columns[(i, s.parameter)] = slope[i] * weight;
        }
        for (k, difference) in moved.by_perturbation.iter().enumerate() {
            let d = difference[i] * weight;
            columns[(i, slots + k)] = if d.is_finite() { d } else { 0.0 };
        }
    }
    for (h, (k, _)) in held.iter().enumerate().filter(|(_, (k, _))| *k < count) {
        let row = seen + 2 * h;
        start[(row, *k)] = weights[row / 2];
        residual[row] =
            if window.kind == SegmentKind::MultiStep { 0.0 } else { window.nuisances[*k] - nuisances[*k] };
    }
    for i in 0..n {
        residual[i] = if weights[i / 2] > 0.0 { residual[i] * weights[i / 2] } else { 0.0 };
    }
    if !residual.iter().chain(columns.iter()).chain(start.iter()).all(|v| v.is_finite()) {
        residual.fill(DIVERGED_RESIDUAL);
        columns.fill(0.0);
        start.fill(0.0);
    }
    let correction = NuisanceUpdate {
        step_at_fixed_parameters: DVector::zeros(count),
        by_parameter: DMatrix::zeros(count, columns.ncols()),
    };
    Linearization {
        weights,
        residual,
        jacobian: columns,
        nuisance_jacobian: start,
        square: 0.0,
        irls_scale: 1.0,
        nuisance_update: correction,
        impact: moved.impact,
    }
}

/// Square roots of the weights of a window's points, over the noise.
fn observation_weights(window: &Segment, sd: f64, residual: &DVector<f64>) -> Vec<f64> {
    let counts = |i: usize| {
        let size = residual[2 * i].hypot(residual[2 * i + 1]) / sd;
        if window.kind == SegmentKind::FromInitialState { HUBER_LIMIT / size.max(HUBER_LIMIT) } else { 1.0 }
    };
    window.observations.iter().enumerate().map(|(i, p)| (p.weight * counts(i)).sqrt() / sd).collect()
}

/// Whether nothing is seen to move along an axis.
fn is_stationary(window: &Segment, axis: usize) -> bool {
    window.observations.iter().all(|p| p.position[axis] == window.observations[0].position[axis])
}

/// The nuisances that are no state, which bounces and rolls need besides, and by how much they may plausibly differ from where
/// they start. A shot's spins are held where they stand.
fn regularised_nuisances(window: &Segment) -> Vec<(usize, f64)> {
    let spin = window.surface.as_ref().map_or(SPIN_SD, |s| s.spin_prior_sd);
    let count = window.nuisances.len();
    let all: Vec<(usize, f64)> = match window.kind {
        SegmentKind::Contact => vec![(4, spin), (5, HEIGHT_SD)],
        SegmentKind::Rolling => vec![(2, HEIGHT_SD), (3, SLOPE_SD)],
        // Every body's fifth nuisance.
        SegmentKind::MultiStep => (4..count).step_by(STATE_FD_STEPS.len()).map(|k| (k, SPIN_SD)).collect(),
        // Along an axis in which nothing is seen to move nothing does: a lift would turn any speed there into a push.
        SegmentKind::Flight => {
            (0..2).filter(|a| is_stationary(window, *a)).map(|a| (2 + a, STATIONARY_SPEED_SD)).collect()
        }
        SegmentKind::FromInitialState | SegmentKind::OneStep => Vec::new(),
    };
    all.into_iter().filter(|(k, _)| *k < count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{flights, multi_step_segments, term};
    use crate::task::Scene;
    use crate::world::Engine;

    fn look(windows: &[Segment], settings: &[usize], nuisances: Vec<f64>) -> Linearization {
        let data = SegmentData::new(windows, settings, vec![1e-3], Engine::Lanes);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let state = FitState::new(vec![0.0, 0.0], vec![nuisances]);
        linearise(&data, &layout, &state, &[]).unwrap().remove(0)
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
        let along = look.nuisance_jacobian.tr_mul(&look.jacobian);
        assert!(along.amax() < 1e-6 * look.nuisance_jacobian.norm() * look.jacobian.norm(), "{along}");
        assert!(
            look.jacobian.column(0).norm() > 100.0,
            "a wind of 1 m/s^2 bends by far more than a millimetre"
        );
        let step = look.nuisance_step(&DVector::zeros(2));
        assert!((step[0] + 0.3).abs() < 1e-6 && (step[3] - 2.0).abs() < 1e-6, "{step}");
    }

    /// Of a launch that has a wind of its own, what is left is the wind's: as if the mode had never been.
    #[test]
    fn what_a_mode_takes_is_given_back() {
        let (windows, settings) = flights([0.5, 0.0], 1);
        let data = SegmentData::new(&windows, &settings, vec![1e-3], Engine::Lanes);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let alike = FitState::new(vec![0.0, 0.0], vec![windows[0].nuisances.clone()]);
        let mode = RandomEffects { deviations: vec![0.5, 0.0], accelerations: Vec::new() };
        let unlike = FitState { random_effects: vec![mode], ..alike.clone() };
        let [alike, unlike] = [alike, unlike].map(|s| linearise(&data, &layout, &s, &[]).unwrap().remove(0));
        assert!(alike.residual.norm() > 30.0, "{}", alike.residual.norm());
        assert!((&alike.residual - &unlike.residual).norm() < 1e-3 * alike.residual.norm());
        assert!((alike.square - unlike.square).abs() < 1e-3 * alike.square);
    }

    #[test]
    fn a_path_that_diverges_is_bad_and_leads_nowhere() {
        let (windows, settings) = flights([0.0, 0.0], 1);
        let look = look(&windows, &settings, vec![f64::INFINITY; 4]);
        assert!(
            look.square >= DIVERGED_RESIDUAL * DIVERGED_RESIDUAL && look.jacobian.iter().all(|c| *c == 0.0)
        );
    }

    /// A shot that is off by a metre counts as its logarithm has it; what is left in metres is what it was.
    #[test]
    fn what_goes_astray_is_made_smaller_and_stays_as_far_off() {
        let (mut windows, settings) = multi_step_segments();
        windows[0].observations[3].position[0] += 1.0;
        let nuisances = windows[0].nuisances.clone();
        let look = look(&windows, &settings, nuisances);
        // 16 coordinates less 10 nuisances, six times what noise leaves of which counts in full.
        let counted = 36.0 * (1.0 - 2.0 * look.irls_scale.ln());
        assert!(
            look.irls_scale < 0.05 && (look.square - counted).abs() < 1e-6,
            "{} {}",
            look.irls_scale,
            look.square
        );
        let most =
            (0..2 * windows[0].observations.len()).map(|i| look.residual_metres(i).abs()).fold(0.0, f64::max);
        assert!((0.2..1.0).contains(&most), "{most} m, the start having taken up some of it");
    }

    /// The spins of the first four bodies were once held, and those of further ones left to wander.
    #[test]
    fn the_spin_of_every_body_of_a_shot_is_held() {
        let spins = |bodies: usize| {
            let shot = Segment::new(SegmentKind::MultiStep, Scene::empty(), 0.0, Vec::new());
            let shot = Segment { nuisances: vec![0.0; 5 * bodies], ..shot };
            regularised_nuisances(&shot).iter().map(|(k, _)| *k).collect::<Vec<_>>()
        };
        assert_eq!(spins(6), [4, 9, 14, 19, 24, 29]);
        assert_eq!(spins(2), [4, 9]);
    }
}
