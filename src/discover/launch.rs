//! Launches as the score sees them: what a model leaves of each, in coordinates in which its covariance is simple.
//!
//! A window's residual and columns are taken in slow coordinates (the polynomials that `noise` holds for motion; where there
//! are few points, the points themselves), its start is projected out by an orthonormal complement (restricted likelihood,
//! with the flat prior on starts in *observed* coordinates, the same for every candidate), noise is made white, and the
//! slow misfit's covariance diagonal. What is left is a Gaussian of covariance
//! diag(1 + slow^2 misfit) + columns' spreads + own columns' variances, in units of the noise.
//!
//! Source: restricted likelihood (Patterson and Thompson, Biometrika 58 (1971) 545), model discrepancy as a Gaussian process
//! (Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425).

use nalgebra::{DMatrix, DVector, Dyn, QR};

use super::columns::{RandomDesign, RandomEffect};
use super::model::Linearization;
use super::noise::{self, Noise};
use super::path::Impact;
use super::window::{Segment, SegmentKind};

/// Length over which slow misfit changes, as a share of the usual flight (the prototype's; Matern 3/2).
const GP_LENGTH_SHARE: f64 = 0.25;

/// Observations that share a scale: all measured windows of a launch, or one stretch that started from what was seen.
#[derive(Clone, Debug)]
pub struct Group {
    /// Index of the trial.
    pub trial: usize,
    /// A block a window: nothing but sizes that differ by launch makes windows depend on each other.
    pub blocks: Vec<SegmentBlock>,
    /// Whether sizes may differ from launch to launch: they do where something was measured.
    pub has_random_effects: bool,
}

/// A window's share of a part.
#[derive(Clone, Debug)]
pub struct SegmentBlock {
    /// Index of the window.
    pub segment: usize,
    /// What the model leaves.
    pub residual: DVector<f64>,
    /// Variance of the slow misfit of unit amplitude, by coordinate.
    pub gp_variance: DVector<f64>,
    /// Derivatives by slot, then by extra.
    pub jacobian: DMatrix<f64>,
    /// What all windows of a launch have alike (pushes, and strengths of effects), of unit standard deviation.
    pub z_group: DMatrix<f64>,
    pub z_group_effects: Vec<RandomEffect>,
    /// Columns with variances of their own, of unit standard deviation.
    pub z_segment: DMatrix<f64>,
    pub z_segment_effects: Vec<RandomEffect>,
    /// Logarithm of the determinant of what made noise white, squared.
    pub log_det_noise: f64,
}

/// What does not change about a window while models do.
#[derive(Clone)]
pub struct BasisCache {
    /// (coordinates, points): slow ones, or the points that count.
    basis: DMatrix<f64>,
    /// Noise, unless it is white, and slow misfit, if there may be any, in them, by coordinate axis.
    noise_covariance: Option<DMatrix<f64>>,
    gp_covariance: Option<DMatrix<f64>>,
    /// Whether anything moved along x and y: what never does is no observation.
    axes: [bool; 2],
    /// Whether it comes after a contact of its trial.
    follows_flight: bool,
}

impl BasisCache {
    /// Covariance of the slow misfit of unit amplitude at the window's points; `None` where there is none.
    pub fn gp_covariance_at_observations(&self) -> Option<DMatrix<f64>> {
        self.gp_covariance.as_ref().map(|slow| self.basis.tr_mul(&(slow * &self.basis)))
    }

    /// Whether the window moves along both axes: what pushes along one that is never seen to move is told by nothing.
    pub fn moves_in_plane(&self) -> bool {
        self.axes == [true; 2]
    }

    /// Whether a contact may have changed what its window flies with.
    pub fn may_be_reset_by_contact(&self, window: &Segment) -> bool {
        self.follows_flight || window.kind == SegmentKind::Contact
    }
}

/// Frames of all windows.
pub fn basis_caches(windows: &[Segment], noise: &Noise) -> Vec<BasisCache> {
    let flights = windows.iter().filter(|w| w.kind == SegmentKind::Flight);
    let durations: Vec<f64> = flights.map(|w| w.observations.last().map_or(0.0, |p| p.time)).collect();
    let length = GP_LENGTH_SHARE * super::stats::median(&durations).max(1e-6);
    let after = |w: &Segment| {
        windows.iter().any(|o| o.trial == w.trial && o.start < w.start && o.kind == SegmentKind::Flight)
    };
    windows.iter().map(|w| basis_cache(w, noise, length, after(w))).collect()
}

fn basis_cache(window: &Segment, noise: &Noise, length: f64, after: bool) -> BasisCache {
    let points = &window.observations;
    let axes = match window.kind.uses_engine() {
        true => [true; 2],
        false => [0, 1].map(|a| points.iter().any(|p| p.position[a] != points[0].position[a])),
    };
    let times: Vec<f64> = points.iter().map(|p| p.time).collect();
    let weights: Vec<f64> = points.iter().map(|p| p.weight).collect();
    let n = points.len();
    let rho = if window.kind.uses_engine() { 0.0 } else { noise.rho };
    let basis = window.smooth.as_ref().and_then(|_| noise::polynomial_basis(&times, &weights));
    let correlation = (rho != 0.0).then(|| noise::ar1_correlation(n, rho));
    let counted: Vec<usize> = (0..n).filter(|i| weights[*i] > 0.0).collect();
    match basis {
        Some(q) => {
            let kernel = DMatrix::from_fn(n, n, |i, j| {
                let d = 3f64.sqrt() * (times[i] - times[j]).abs() / length;
                (1.0 + d) * libm::exp(-d)
            });
            let within = |m: DMatrix<f64>| q.tr_mul(&(m * &q));
            BasisCache {
                noise_covariance: correlation.map(within),
                gp_covariance: Some(within(kernel)),
                basis: q.transpose(),
                axes,
                follows_flight: after,
            }
        }
        None => BasisCache {
            // What does not count is no coordinate.
            basis: DMatrix::from_fn(counted.len(), n, |k, i| f64::from(counted[k] == i)),
            gp_covariance: None,
            noise_covariance: correlation.map(|c| c.select_rows(&counted).select_columns(&counted)),
            axes,
            follows_flight: after,
        },
    }
}

/// A window's part of its launch; `scale` is by how much its residuals were made smaller than in units of the noise.
fn segment_block(
    (w, window): (usize, &Segment),
    frame: &BasisCache,
    look: &Linearization,
    columns: &RandomDesign,
    scale: f64,
) -> Option<SegmentBlock> {
    let (slots, pushes) = (columns.parameter_count, columns.acceleration_count);
    let impact = look.impact;
    let n = window.observations.len();
    let extras = look.jacobian.ncols() - slots - pushes;
    let leaps = impact.map_or(0, |_| 2);
    let order =
        ColumnIndex { parameters: slots, perturbations: extras, accelerations: pushes, impact_errors: leaps };
    let of = |c: usize, i: usize| match c {
        _ if c < slots => look.jacobian[(i, c)],
        _ if c < slots + extras => look.jacobian[(i, c + pushes)],
        _ if c < order.impact_error(0) => look.jacobian[(i, c - extras)],
        _ if c == order.residual() => look.residual[i],
        _ => impact_error_response(window, look, impact, c - order.impact_error(0), i),
    };
    let rows = RowAssembler {
        axes: (0..2).filter(|a| frame.axes[*a]).collect(),
        points: n,
        coordinates: frame.basis.nrows(),
        pseudo_observations: (look.residual.len() - 2 * n) / 2,
        irls_scale: look.irls_scale,
        scale: scale / look.irls_scale,
    };
    let start = rows.assemble(frame, look.nuisance_jacobian.ncols(), &|c, i| look.nuisance_jacobian[(i, c)]);
    let simple = whiten_columns(frame, &rows, &start, rows.assemble(frame, order.residual() + 1, &of))?;
    if simple.columns.iter().any(|v| !v.is_finite()) {
        return None;
    }
    Some(assemble_block(simple, &order, columns, (w, window), frame))
}

/// Which column of a window's block is which: slots, extras, pushes, leaps, and what is left.
struct ColumnIndex {
    parameters: usize,
    perturbations: usize,
    accelerations: usize,
    impact_errors: usize,
}

impl ColumnIndex {
    fn acceleration(&self, k: usize) -> usize {
        self.parameters + self.perturbations + k
    }

    fn impact_error(&self, k: usize) -> usize {
        self.acceleration(self.accelerations) + k
    }

    fn residual(&self) -> usize {
        self.impact_error(self.impact_errors)
    }
}

/// How a look's rows come to be coordinates: slow ones, axis after axis, then what is held of nuisances.
struct RowAssembler {
    axes: Vec<usize>,
    points: usize,
    coordinates: usize,
    pseudo_observations: usize,
    irls_scale: f64,
    scale: f64,
}

impl RowAssembler {
    /// All of them.
    fn dims(&self) -> usize {
        self.coordinates * self.axes.len() + self.pseudo_observations
    }

    /// `count` columns whose values by column and row are given.
    fn assemble(
        &self,
        frame: &BasisCache,
        count: usize,
        value: &dyn Fn(usize, usize) -> f64,
    ) -> DMatrix<f64> {
        let (n, k) = (self.points, self.coordinates);
        let mut out = DMatrix::zeros(self.dims(), count);
        for (b, axis) in self.axes.iter().enumerate() {
            let rows = DMatrix::from_fn(n, count, |i, c| value(c, 2 * i + axis) * self.scale);
            out.rows_mut(b * k, k).copy_from(&(&frame.basis * rows));
        }
        for (h, c) in (0..self.pseudo_observations).flat_map(|h| (0..count).map(move |c| (h, c))) {
            out[(k * self.axes.len() + h, c)] = value(c, 2 * n + 2 * h) / self.irls_scale;
        }
        out
    }

    /// A covariance of an axis in all coordinates across a start; `rest` of each that is held.
    fn project_covariance(&self, axis: &DMatrix<f64>, rest: f64, across: &NullSpace) -> DMatrix<f64> {
        let k = self.coordinates;
        let mut out = DMatrix::zeros(self.dims(), self.dims());
        for b in 0..self.axes.len() {
            out.view_mut((b * k, b * k), (k, k)).copy_from(axis);
        }
        (k * self.axes.len()..self.dims()).for_each(|h| out[(h, h)] = rest);
        across.project(across.project(out).transpose())
    }
}

/// Columns in coordinates in which noise is white and slow misfit uncorrelated.
struct Whitened {
    columns: DMatrix<f64>,
    gp_variance: DVector<f64>,
    log_det_noise: f64,
}

/// Takes the start away, makes noise white and the slow misfit's covariance diagonal.
fn whiten_columns(
    frame: &BasisCache,
    rows: &RowAssembler,
    start: &DMatrix<f64>,
    of: DMatrix<f64>,
) -> Option<Whitened> {
    let across = NullSpace::of(start)?;
    let mut columns = across.project(of);
    let mut log_white = 0.0;
    let mut misfit = frame.gp_covariance.as_ref().map(|slow| rows.project_covariance(slow, 0.0, &across));
    if let Some(white) = &frame.noise_covariance {
        let white = rows.project_covariance(white, 1.0, &across).cholesky()?;
        log_white = 2.0 * white.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let root = white.l();
        columns = root.solve_lower_triangular(&columns)?;
        if let Some(own) = &mut misfit {
            let half = root.solve_lower_triangular(own)?;
            *own = root.solve_lower_triangular(&half.transpose())?;
        }
    }
    let mut slow = DVector::zeros(columns.nrows());
    if let Some(misfit) = misfit {
        let eigen = (0.5 * (&misfit + misfit.transpose())).symmetric_eigen();
        slow = eigen.eigenvalues.map(|v| v.max(0.0));
        columns = eigen.eigenvectors.transpose() * columns;
    }
    Some(Whitened { columns, gp_variance: slow, log_det_noise: log_white })
}

/// Which of the columns the model fits, which a launch has alike in all its windows, and which each window has of its own.
fn assemble_block(
    simple: Whitened,
    order: &ColumnIndex,
    columns: &RandomDesign,
    (w, window): (usize, &Segment),
    frame: &BasisCache,
) -> SegmentBlock {
    let column = |c: usize| simple.columns.column(c).into_owned();
    let m = simple.columns.nrows();
    let mut own: Vec<(RandomEffect, DVector<f64>)> = Vec::new();
    let mut alike: Vec<(RandomEffect, DVector<f64>)> = Vec::new();
    let flies = matches!(window.kind, SegmentKind::Flight | SegmentKind::Contact);
    for (k, (place, fresh)) in columns.accelerations.iter().enumerate() {
        match fresh {
            true if flies => own.push((RandomEffect::Acceleration(*place), column(order.acceleration(k)))),
            true => (),
            false if flies => alike.push((RandomEffect::Acceleration(*place), column(order.acceleration(k)))),
            false => alike.push((RandomEffect::Acceleration(*place), DVector::zeros(m))),
        }
    }
    let renewed =
        columns.contact_resets.iter().enumerate().filter(|_| flies && frame.may_be_reset_by_contact(window));
    for (k, (c, plausible)) in renewed {
        let at = if *c < order.parameters { *c } else { order.acceleration(*c - order.parameters) };
        own.push((RandomEffect::ContactReset(k), column(at) * *plausible));
    }
    own.extend((0..order.impact_errors).map(|k| (RandomEffect::ImpactNoise, column(order.impact_error(k)))));
    for sizes in &columns.amplitude_directions {
        let all = sizes.iter().fold(DVector::zeros(m), |all, (slot, size)| all + column(*slot) * *size);
        alike.push((RandomEffect::Scale, all));
    }
    let beside = |of: &[(RandomEffect, DVector<f64>)]| DMatrix::from_fn(m, of.len(), |i, k| of[k].1[i]);
    let names = |of: &[(RandomEffect, DVector<f64>)]| of.iter().map(|o| o.0).collect();
    SegmentBlock {
        segment: w,
        residual: column(order.residual()),
        jacobian: simple.columns.columns(0, order.acceleration(0)).into_owned(),
        z_group: beside(&alike),
        z_group_effects: names(&alike),
        z_segment: beside(&own),
        z_segment_effects: names(&own),
        gp_variance: simple.gp_variance,
        log_det_noise: simple.log_det_noise,
    }
}

/// What a contact that errs along its normal (0) or its tangent (1) by its speed of approach does to row `i`.
pub fn impact_error_response(
    window: &Segment,
    look: &Linearization,
    impact: Option<Impact>,
    way: usize,
    i: usize,
) -> f64 {
    let (Some(met), Some(surface)) = (impact, &window.surface) else { return 0.0 };
    let Some(point) = window.observations.get(i / 2) else { return 0.0 };
    let [nx, ny] = surface.normal;
    let along = [[nx, ny], [-ny, nx]][way][i % 2];
    (point.time - met.time).max(0.0) * along * met.approach * look.weights[i / 2] * look.irls_scale
}

/// Everything across the columns of a start.
struct NullSpace {
    basis: QR<f64, Dyn, Dyn>,
    rank: usize,
}

impl NullSpace {
    /// `None` where nothing is left beside the start.
    fn of(start: &DMatrix<f64>) -> Option<NullSpace> {
        let mut basis: Vec<DVector<f64>> = Vec::new();
        for column in start.column_iter() {
            let size = column.norm();
            let mut rest = column.into_owned();
            for _ in 0..2 {
                for b in &basis {
                    let along = b.dot(&rest);
                    rest.axpy(-along, b, 1.0);
                }
            }
            if rest.norm() > 1e-9 * size && size > 0.0 {
                basis.push(rest.normalize());
            }
        }
        let rank = basis.len();
        let columns = DMatrix::from_fn(start.nrows(), rank, |i, k| basis[k][i]);
        (rank < start.nrows()).then(|| NullSpace { basis: columns.qr(), rank })
    }

    /// Coordinates across the start, of every column.
    fn project(&self, mut of: DMatrix<f64>) -> DMatrix<f64> {
        if self.rank > 0 {
            self.basis.q_tr_mul(&mut of);
        }
        of.rows(self.rank, of.nrows() - self.rank).into_owned()
    }
}

/// All launches' parts. `looks`: every window at a state, with columns for `slots`, then [`pushes`], then extras;
/// `scales`: of each window's residuals, in units of the noise.
pub fn groups(
    windows: &[Segment],
    frames: &[BasisCache],
    looks: &[Linearization],
    columns: &RandomDesign,
    scales: &[f64],
) -> Option<Vec<Group>> {
    let mut out: Vec<Group> = Vec::new();
    for (w, window) in windows.iter().enumerate().filter(|(w, _)| scales[*w].is_finite()) {
        let Some(block) = segment_block((w, window), &frames[w], &looks[w], columns, scales[w]) else {
            if looks[w].residual.iter().all(|r| r.is_finite()) {
                continue;
            }
            return None;
        };
        let differs = !window.kind.uses_engine();
        match out.last_mut() {
            Some(last) if last.trial == window.trial && last.has_random_effects && differs => {
                last.blocks.push(block)
            }
            _ => out.push(Group { trial: window.trial, blocks: vec![block], has_random_effects: differs }),
        }
    }
    Some(out)
}

/// By how much a window's coordinates of what is left grow with what was seen, 1/m: (coordinates, two a point). `None` where nothing
/// is left beside its start.
pub fn observation_jacobian(
    window: (usize, &Segment),
    frame: &BasisCache,
    look: &Linearization,
    scale: f64,
) -> Option<DMatrix<f64>> {
    let n = 2 * window.1.observations.len();
    let mut own = look.without_jacobian();
    own.append_columns(n, Some(DMatrix::identity(n, n)));
    let none = RandomDesign {
        parameter_count: 0,
        acceleration_count: 0,
        accelerations: Vec::new(),
        contact_resets: Vec::new(),
        amplitude_directions: Vec::new(),
    };
    segment_block(window, frame, &own, &none, scale).map(|block| block.jacobian)
}

impl SegmentBlock {
    /// Residual after a step of the parameters.
    pub fn residual_at(&self, step: &DVector<f64>) -> DVector<f64> {
        &self.residual - &self.jacobian * step
    }
}

impl Group {
    /// Square of what is left with the slots `step` away, in units of the noise.
    pub fn square_at(&self, step: &DVector<f64>) -> f64 {
        self.blocks.iter().map(|b| b.residual_at(step).norm_squared()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a start takes up is gone, whatever its columns are scaled by, and lengths across it are kept.
    #[test]
    fn a_start_is_projected_out() {
        let start = DMatrix::from_fn(6, 3, |i, k| match k {
            0 => 1.0,
            1 => 1e4 * i as f64,
            _ => 0.0,
        });
        let across = NullSpace::of(&start).unwrap();
        let line = DMatrix::from_fn(6, 1, |i, _| 3.0 - 2.0 * i as f64);
        assert!(across.project(line).norm() < 1e-9);
        let bend = DMatrix::from_column_slice(6, 1, &[5.0, -1.0, -4.0, -4.0, -1.0, 5.0]);
        let seen = across.project(bend.clone());
        assert_eq!(seen.nrows(), 4, "a column of nothing takes nothing up");
        assert!((seen.norm() - bend.norm()).abs() < 1e-9);
    }
}
