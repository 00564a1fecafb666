//! Linearization of a segment at a state: residual and Jacobian in units of the noise, nuisances projected
//! out.
//!
//! Source: variable projection (Golub and Pereyra 1973), Kaufman's variant.

use nalgebra::{DMatrix, DVector};

use super::engine_linearization::{STATE_FD_STEPS, linearise_engine};
use super::finite_differences::{Prediction, Stencil, linearise_ode, stencils};
use super::fit_state::{FitState, Perturbation, RandomEffects};
use super::parameters::ParameterLayout;
use super::robust_loss::{irls_scale, robust_square};
use super::segment_data::SegmentData;
use crate::error::Result;
use crate::inference::dynamics::Impact;
use crate::inference::segment::{COLLISION_NUISANCES, CONTACT_NUISANCES, Segment, SegmentKind};
use crate::inference::statistics::pseudo_inverse;

/// Limit of Huber's loss for initial segments, in noise standard deviations (Huber 1964).
const HUBER_LIMIT: f64 = 3.0;
/// Residual of a diverged trajectory, in units of the noise; its Jacobian is zero.
const DIVERGED_RESIDUAL: f64 = 1e3;
/// Prior standard deviations of nuisances: spin, rad/s; offset, m, and slope of a surface.
const SPIN_SD: f64 = 3.0;
const HEIGHT_SD: f64 = 0.01;
const SLOPE_SD: f64 = 0.005;
/// Prior standard deviation of the speed along an axis without observed motion, m/s.
const STATIONARY_SPEED_SD: f64 = 0.01;

/// Residual of a segment with its derivatives by parameters and perturbations.
#[derive(Clone)]
pub struct Linearization {
    /// Square roots of weights over the noise standard deviation, by observation and regularised nuisance; 0
    /// for unused observations.
    pub weights: Vec<f64>,
    pub residual: DVector<f64>,
    /// A column per parameter, then per perturbation.
    pub jacobian: DMatrix<f64>,
    /// A column per nuisance.
    pub nuisance_jacobian: DMatrix<f64>,
    /// Squared residual under the robust loss.
    pub square: f64,
    /// Square root of the weight in iteratively reweighted least squares, by which residual and Jacobians are
    /// multiplied.
    pub irls_scale: f64,
    pub nuisance_update: NuisanceUpdate,
    /// Impact of a contact segment.
    pub impact: Option<Impact>,
}

/// Back-substitution of the projected nuisances: their optimal step at fixed parameters, and its derivative
/// by the parameters.
#[derive(Clone)]
pub struct NuisanceUpdate {
    step_at_fixed_parameters: DVector<f64>,
    by_parameter: DMatrix<f64>,
}

impl NuisanceUpdate {
    /// Step of the nuisances after a step of the first parameters.
    pub fn step(&self, columns: &DVector<f64>) -> DVector<f64> {
        &self.step_at_fixed_parameters - self.by_parameter.columns(0, columns.len()) * columns
    }
}

/// Linearizes every segment at the conditional modes of its trial's random effects; their contribution is
/// then restored, so that residuals are those without random effects. If the state has random effects,
/// `perturbations` begin with their accelerations.
pub fn linearise(
    data: &SegmentData,
    layout: &ParameterLayout,
    state: &FitState,
    perturbations: &[Perturbation],
) -> Result<Vec<Linearization>> {
    let mut simulated = linearise_engine(data, layout, state, perturbations)?.into_iter();
    let parameters = layout.parameters.len();
    let linearization = |w: usize, segment: &Segment| {
        let nuisances = &state.nuisances[w];
        let shared = stencils(layout, &state.values_in(w), segment);
        let moved = match segment.kind.uses_engine() {
            true => simulated.next().unwrap_or_default(),
            false => linearise_ode(segment, w, layout, state, &shared, perturbations),
        };
        let mut linearization = whiten(segment, data.sd[w], parameters, &shared, nuisances, moved);
        linearization.project_out_nuisances();
        if let Some(mode) = state.random_effects.get(w) {
            linearization.restore_random_effects(mode, parameters);
        }
        linearization.apply_robust_loss(segment);
        linearization.square += segment.within_blocks.sum_of_squares / (data.sd[w] * data.sd[w]);
        linearization
    };
    data.each_segment(linearization)
}

impl Linearization {
    /// Step of the nuisances after a step of the first parameters.
    pub fn nuisance_step(&self, step: &DVector<f64>) -> DVector<f64> {
        self.nuisance_update.step(step)
    }

    /// Residual of a row, m; NaN if it is not used.
    pub fn residual_metres(&self, row: usize) -> f64 {
        let weight = self.weights[row / 2];
        if weight > 0.0 { self.residual[row] / (self.irls_scale * weight) } else { f64::NAN }
    }

    /// Projects the nuisances out of residual and Jacobian.
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

    /// Restores the contribution of the random effects to first order.
    fn restore_random_effects(&mut self, mode: &RandomEffects, parameters: usize) {
        let accelerations = mode.accelerations.iter().map(|p| p.1);
        let sizes = mode
            .deviations
            .iter()
            .copied()
            .enumerate()
            .chain(accelerations.enumerate().map(|(k, a)| (parameters + k, a)));
        for (column, size) in sizes.filter(|(_, size)| *size != 0.0) {
            self.residual.axpy(size, &self.jacobian.column(column), 1.0);
        }
        self.square = self.residual.norm_squared();
    }

    /// Applies the robust loss to segments that may diverge chaotically.
    fn apply_robust_loss(&mut self, segment: &Segment) {
        let left = 2.0 * segment.observations.len() as f64 - self.nuisance_jacobian.ncols() as f64;
        let share = irls_scale(self.square, left);
        if segment.kind.is_chaotic() && share < 1.0 {
            self.irls_scale = share;
            self.residual *= share;
            self.jacobian *= share;
            self.nuisance_jacobian *= share;
            self.square = robust_square(self.square, left);
        }
    }
}

/// Whitened residual and Jacobians. Priors of nuisances are pseudo-observations: two more rows each, of which
/// the second is empty.
fn whiten(
    segment: &Segment,
    sd: f64,
    parameters: usize,
    shared: &[Stencil],
    nuisances: &[f64],
    moved: Prediction,
) -> Linearization {
    let held = regularised_nuisances(segment);
    let (observed, count) = (moved.positions.len(), moved.by_nuisance.len());
    let n = observed + 2 * held.len();
    let off = |i: usize| {
        if i < observed { segment.observations[i / 2].position[i % 2] - moved.positions[i] } else { 0.0 }
    };
    let mut residual = DVector::from_fn(n, |i, _| off(i));
    let mut weights = observation_weights(segment, sd, &residual);
    weights.extend(held.iter().map(|(_, plausible)| 1.0 / plausible));
    let mut start = DMatrix::zeros(n, count);
    let mut columns = DMatrix::zeros(n, parameters + moved.by_perturbation.len());
    for i in 0..observed {
        let weight = weights[i / 2];
        for (k, slope) in moved.by_nuisance.iter().enumerate() {
            start[(i, k)] = slope[i] * weight;
        }
        for (s, slope) in shared.iter().zip(&moved.by_parameter) {
            columns[(i, s.parameter)] = slope[i] * weight;
        }
        for (k, difference) in moved.by_perturbation.iter().enumerate() {
            let d = difference[i] * weight;
            columns[(i, parameters + k)] = if d.is_finite() { d } else { 0.0 };
        }
    }
    for (h, (k, _)) in held.iter().enumerate().filter(|(_, (k, _))| *k < count) {
        let row = observed + 2 * h;
        start[(row, *k)] = weights[row / 2];
        residual[row] =
            if segment.kind == SegmentKind::MultiStep { 0.0 } else { segment.nuisances[*k] - nuisances[*k] };
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

/// Square roots of the weights of a segment's observations, over the noise.
fn observation_weights(segment: &Segment, sd: f64, residual: &DVector<f64>) -> Vec<f64> {
    let counts = |i: usize| {
        let size = residual[2 * i].hypot(residual[2 * i + 1]) / sd;
        if segment.kind == SegmentKind::FromInitialState { HUBER_LIMIT / size.max(HUBER_LIMIT) } else { 1.0 }
    };
    segment.observations.iter().enumerate().map(|(i, p)| (p.weight * counts(i)).sqrt() / sd).collect()
}

/// Whether the observed position along an axis is constant.
fn is_stationary(segment: &Segment, axis: usize) -> bool {
    segment.observations.iter().all(|p| p.position[axis] == segment.observations[0].position[axis])
}

/// Nuisances with a proper prior, and their prior standard deviations. Spins of multi-step segments have the
/// current value as prior mean.
fn regularised_nuisances(segment: &Segment) -> Vec<(usize, f64)> {
    let spin = segment.surface.as_ref().map_or(SPIN_SD, |s| s.spin_prior_sd);
    let count = segment.nuisances.len();
    let all: Vec<(usize, f64)> = match segment.kind {
        SegmentKind::Contact | SegmentKind::Landing => {
            let angle = segment.surface.map_or(0.0, |s| s.angle_prior_sd);
            vec![(4, spin), (5, HEIGHT_SD), (CONTACT_NUISANCES, angle)]
        }
        SegmentKind::Collision => {
            let [first, second] = segment.pair.map_or([SPIN_SD; 2], |pair| pair.spin_prior_sd);
            let [turned, other] = segment.pair.map_or([0.0; 2], |pair| pair.angle_prior_sd);
            let angles = [(COLLISION_NUISANCES, turned), (COLLISION_NUISANCES + 1, other)];
            [&[(4, first), (9, second), (10, HEIGHT_SD)][..], &angles].concat()
        }
        SegmentKind::Rolling | SegmentKind::Sliding => vec![(2, HEIGHT_SD), (3, SLOPE_SD), (4, spin)],
        // The spin of every body.
        SegmentKind::MultiStep => (4..count).step_by(STATE_FD_STEPS.len()).map(|k| (k, SPIN_SD)).collect(),
        // Speed along an axis without observed motion: a lift would turn it into an acceleration.
        SegmentKind::Flight => {
            (0..2).filter(|a| is_stationary(segment, *a)).map(|a| (2 + a, STATIONARY_SPEED_SD)).collect()
        }
        SegmentKind::FromInitialState | SegmentKind::OneStep => Vec::new(),
    };
    all.into_iter().filter(|(k, _)| *k < count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{flights, multi_step_segments, term};
    use crate::task::Scene;
    use crate::world::Engine;

    fn look(segments: &[Segment], settings: &[usize], nuisances: Vec<f64>) -> Linearization {
        let data = SegmentData::new(segments, settings, vec![1e-3], Engine::Lanes);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let state = FitState::new(vec![0.0, 0.0], vec![nuisances]);
        linearise(&data, &layout, &state, &[]).unwrap().remove(0)
    }

    /// The effect of a wrong initial state is projected out and its correction is known; the curvature by a
    /// wind remains.
    #[test]
    fn wrong_initial_states_are_projected_out() {
        let (segments, settings) = flights([0.0, 0.0], 1);
        let mut wrong = segments[0].nuisances.clone();
        wrong[0] += 0.3;
        wrong[3] -= 2.0;
        let linearization = look(&segments, &settings, wrong);
        assert!(linearization.square < 1e-6, "{}", linearization.square);
        let along = linearization.nuisance_jacobian.tr_mul(&linearization.jacobian);
        assert!(
            along.amax() < 1e-6 * linearization.nuisance_jacobian.norm() * linearization.jacobian.norm(),
            "{along}"
        );
        assert!(
            linearization.jacobian.column(0).norm() > 100.0,
            "a wind of 1 m/s^2 bends by far more than a millimetre"
        );
        let step = linearization.nuisance_step(&DVector::zeros(2));
        assert!((step[0] + 0.3).abs() < 1e-6 && (step[3] - 2.0).abs() < 1e-6, "{step}");
    }

    /// With random effects at their modes the residual is that without random effects.
    #[test]
    fn random_effects_are_restored() {
        let (segments, settings) = flights([0.5, 0.0], 1);
        let data = SegmentData::new(&segments, &settings, vec![1e-3], Engine::Lanes);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let alike = FitState::new(vec![0.0, 0.0], vec![segments[0].nuisances.clone()]);
        let mode = RandomEffects { deviations: vec![0.5, 0.0], accelerations: Vec::new() };
        let unlike = FitState { random_effects: vec![mode], ..alike.clone() };
        let [alike, unlike] = [alike, unlike].map(|s| linearise(&data, &layout, &s, &[]).unwrap().remove(0));
        assert!(alike.residual.norm() > 30.0, "{}", alike.residual.norm());
        assert!((&alike.residual - &unlike.residual).norm() < 1e-3 * alike.residual.norm());
        assert!((alike.square - unlike.square).abs() < 1e-3 * alike.square);
    }

    #[test]
    fn diverged_trajectories_have_large_residuals_and_zero_jacobian() {
        let (segments, settings) = flights([0.0, 0.0], 1);
        let linearization = look(&segments, &settings, vec![f64::INFINITY; 4]);
        assert!(
            linearization.square >= DIVERGED_RESIDUAL * DIVERGED_RESIDUAL
                && linearization.jacobian.iter().all(|c| *c == 0.0)
        );
    }

    /// A residual of a metre has the robust loss; in metres it is unchanged.
    #[test]
    fn robust_loss_keeps_residuals_in_metres() {
        let (mut segments, settings) = multi_step_segments();
        segments[0].observations[3].position[0] += 1.0;
        let nuisances = segments[0].nuisances.clone();
        let linearization = look(&segments, &settings, nuisances);
        // 6 degrees of freedom; the loss is quadratic up to 6 times that.
        let counted = 36.0 * (1.0 - 2.0 * linearization.irls_scale.ln());
        assert!(
            linearization.irls_scale < 0.05 && (linearization.square - counted).abs() < 1e-6,
            "{} {}",
            linearization.irls_scale,
            linearization.square
        );
        let most = (0..2 * segments[0].observations.len())
            .map(|i| linearization.residual_metres(i).abs())
            .fold(0.0, f64::max);
        assert!((0.2..1.0).contains(&most), "{most} m, the start having taken up some of it");
    }

    /// Regression test: only the spins of the first four bodies were regularised.
    #[test]
    fn spins_of_all_bodies_are_regularised() {
        let spins = |bodies: usize| {
            let shot = Segment::new(SegmentKind::MultiStep, Scene::empty(), 0.0, Vec::new());
            let shot = Segment { nuisances: vec![0.0; 5 * bodies], ..shot };
            regularised_nuisances(&shot).iter().map(|(k, _)| *k).collect::<Vec<_>>()
        };
        assert_eq!(spins(6), [4, 9, 14, 19, 24, 29]);
        assert_eq!(spins(2), [4, 9]);
    }
}
