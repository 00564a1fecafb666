//! Groups of the mixed model: rotates and whitens residuals, so that their covariance is diagonal plus low
//! rank.
//!
//! Residual and Jacobian of a segment are projected on the smoothing polynomials (or, with few observations,
//! kept as they are); nuisances are projected out by an orthonormal complement (restricted likelihood with a
//! flat prior of the initial state in *observed* coordinates, the same for every candidate); noise is
//! whitened, and the covariance of the trial discrepancy diagonalised. The covariance is then diag(1 +
//! discrepancy^2 variance) + group-level effects + segment-level effects, in units of the noise.
//!
//! Source: restricted likelihood (Patterson and Thompson, Biometrika 58 (1971) 545), model discrepancy as a Gaussian process
//! (Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425).

use std::borrow::Cow;
use std::collections::HashMap;

use nalgebra::{DMatrix, DVector, Dyn, QR};

use crate::error::Result;
use crate::inference::data::noise::{self, Noise};
use crate::inference::dynamics::Impact;
use crate::inference::kernels;
use crate::inference::mixed_model::random_design::{RandomDesign, RandomEffect};
use crate::inference::model::{Linearization, SegmentData};
use crate::inference::segment::{Segment, SegmentKind};

/// Length scale of the trial discrepancy (Matern 3/2), as a share of the median duration of flights and rolls.
const GP_LENGTH_SHARE: f64 = 0.25;

/// A group of observations with a common scale: all measured segments of a trial, or one engine-simulated
/// segment.
#[derive(Clone, Debug)]
pub struct Group {
    /// Index of the trial.
    pub trial: usize,
    /// One block per segment; segments are correlated by group-level effects only.
    pub blocks: Vec<SegmentBlock>,
    /// Whether it has random effects: measured segments do.
    pub has_random_effects: bool,
}

/// A segment in a group.
#[derive(Clone, Debug)]
pub struct SegmentBlock {
    /// Index of the segment.
    pub segment: usize,
    /// Residual.
    pub residual: DVector<f64>,
    /// Variance of the unit trial discrepancy, by coordinate.
    pub gp_variance: DVector<f64>,
    /// Derivatives by parameters, then by perturbations.
    pub jacobian: DMatrix<f64>,
    /// Group-level random-effect columns (accelerations, scales), for one standard deviation.
    pub z_group: DMatrix<f64>,
    pub z_group_effects: Vec<RandomEffect>,
    /// Segment-level random-effect columns, for one standard deviation.
    pub z_segment: DMatrix<f64>,
    pub z_segment_effects: Vec<RandomEffect>,
    /// Log determinant of the noise covariance.
    pub log_det_noise: f64,
}

/// Quantities of a segment that are the same for all models.
#[derive(Clone)]
pub struct BasisCache {
    /// Coordinates by observations: smoothing polynomials, or the used observations.
    basis: DMatrix<f64>,
    /// Covariances of noise (`None`: white) and of the trial discrepancy (`None`: none) in these coordinates,
    /// per axis.
    noise_covariance: Option<DMatrix<f64>>,
    gp_covariance: Option<DMatrix<f64>>,
    /// Whether the position along x and y varies; a constant coordinate is not used.
    axes: [bool; 2],
    /// Whether an earlier flight of its trial exists.
    follows_flight: bool,
}

impl BasisCache {
    /// Covariance of the unit trial discrepancy at the segment's observations, in two factors: the covariance in
    /// coordinates times the basis (coordinates, observations), and the basis; `None` if there is none.
    pub fn gp_covariance_at_observations(&self) -> Option<(DMatrix<f64>, &DMatrix<f64>)> {
        self.gp_covariance.as_ref().map(|slow| (slow * &self.basis, &self.basis))
    }

    /// Whether the segment moves along both axes.
    pub fn moves_in_plane(&self) -> bool {
        self.axes == [true; 2]
    }

    /// Whether a contact may have reset random accelerations of the segment.
    pub fn may_be_reset_by_contact(&self, segment: &Segment) -> bool {
        self.follows_flight || segment.kind == SegmentKind::Contact
    }
}

/// Model-independent quantities of all segments.
pub fn basis_caches(segments: &[Segment], noise: &Noise) -> Vec<BasisCache> {
    let smooth = segments.iter().filter(|w| matches!(w.kind, SegmentKind::Flight | SegmentKind::Rolling));
    let durations: Vec<f64> = smooth.map(|w| w.observations.last().map_or(0.0, |p| p.time)).collect();
    let length = GP_LENGTH_SHARE * crate::inference::statistics::median(&durations).max(1e-6);
    let mut first: HashMap<usize, f64> = HashMap::new();
    for flight in segments.iter().filter(|w| w.kind == SegmentKind::Flight) {
        let start = first.entry(flight.trial).or_insert(flight.start);
        *start = start.min(flight.start);
    }
    let after = |w: &Segment| first.get(&w.trial).is_some_and(|start| *start < w.start);
    segments.iter().map(|w| basis_cache(w, noise, length, after(w))).collect()
}

fn basis_cache(segment: &Segment, noise: &Noise, length: f64, after: bool) -> BasisCache {
    let points = &segment.observations;
    let axes = match segment.kind.uses_engine() {
        true => [true; 2],
        false => [0, 1].map(|a| points.iter().any(|p| p.position[a] != points[0].position[a])),
    };
    let times: Vec<f64> = points.iter().map(|p| p.time).collect();
    let sizes: Vec<f64> = points.iter().map(|p| p.weight).collect();
    // Rows are in units of their own noise: a mean of several observations has less.
    let weights: Vec<f64> = sizes.iter().map(|size| size.sqrt()).collect();
    let n = points.len();
    let rho = if segment.kind.uses_engine() { 0.0 } else { noise.rho };
    let basis = segment.smooth.as_ref().and_then(|_| noise::polynomial_basis(&times, &weights));
    let counted: Vec<usize> = (0..n).filter(|i| weights[*i] > 0.0).collect();
    match basis {
        Some(q) => BasisCache {
            noise_covariance: (rho != 0.0).then(|| q.tr_mul(&kernels::autoregressive(rho, &sizes, &q))),
            gp_covariance: Some(discrepancy_covariance(&times, &weights, length, &q)),
            basis: q.transpose(),
            axes,
            follows_flight: after,
        },
        None => BasisCache {
            // Unused observations are no coordinates.
            basis: DMatrix::from_fn(counted.len(), n, |k, i| f64::from(counted[k] == i)),
            gp_covariance: None,
            noise_covariance: (rho != 0.0).then(|| noise::ar1_correlation(&counted, rho)),
            axes,
            follows_flight: after,
        },
    }
}

/// Covariance of the unit trial discrepancy in the coordinates of `basis`, in units of the noise of each
/// observation.
fn discrepancy_covariance(times: &[f64], weights: &[f64], length: f64, basis: &DMatrix<f64>) -> DMatrix<f64> {
    let rows = DMatrix::from_fn(basis.nrows(), basis.ncols(), |i, k| weights[i] * basis[(i, k)]);
    rows.tr_mul(&kernels::matern(times, length, &rows))
}

/// Block of a segment; `scale`: its residual standard deviation relative to the noise.
fn segment_block(
    (w, segment): (usize, &Segment),
    frame: &BasisCache,
    linearization: &Linearization,
    columns: &RandomDesign,
    scale: f64,
) -> Option<SegmentBlock> {
    let (parameters, accelerations) = (columns.parameter_count, columns.acceleration_count);
    let impact = linearization.impact;
    let n = segment.observations.len();
    let perturbations = linearization.jacobian.ncols() - parameters - accelerations;
    let impact_errors = impact.map_or(0, |_| 2);
    let order = ColumnIndex { parameters, perturbations, accelerations, impact_errors };
    let of = |c: usize, i: usize| match c {
        _ if c < parameters => linearization.jacobian[(i, c)],
        _ if c < parameters + perturbations => linearization.jacobian[(i, c + accelerations)],
        _ if c < order.impact_error(0) => linearization.jacobian[(i, c - perturbations)],
        _ if c == order.residual() => linearization.residual[i],
        _ => impact_error_response(segment, linearization, impact, c - order.impact_error(0), i),
    };
    let rows = RowAssembler {
        axes: (0..2).filter(|a| frame.axes[*a]).collect(),
        points: n,
        coordinates: frame.basis.nrows(),
        pseudo_observations: (linearization.residual.len() - 2 * n) / 2,
        irls_scale: linearization.irls_scale,
        scale: scale / linearization.irls_scale,
    };
    let start = rows.assemble(frame, linearization.nuisance_jacobian.ncols(), &|c, i| {
        linearization.nuisance_jacobian[(i, c)]
    });
    let simple = whiten_columns(frame, &rows, &start, rows.assemble(frame, order.residual() + 1, &of))?;
    if simple.columns.iter().any(|v| !v.is_finite()) {
        return None;
    }
    Some(assemble_block(simple, &order, columns, (w, segment), frame))
}

/// Column indices: parameters, perturbations, accelerations, impact errors, residual.
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

/// Maps rows of a linearization to coordinates: polynomials, axis by axis, then pseudo-observations of
/// nuisances.
struct RowAssembler {
    axes: Vec<usize>,
    points: usize,
    coordinates: usize,
    pseudo_observations: usize,
    irls_scale: f64,
    scale: f64,
}

impl RowAssembler {
    /// Number of coordinates.
    fn dims(&self) -> usize {
        self.coordinates * self.axes.len() + self.pseudo_observations
    }

    /// Coordinates of `count` columns with given values by column and row.
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

    /// Projects a covariance per axis on the complement of the nuisances; `rest`: variance of
    /// pseudo-observations.
    fn project_covariance(&self, axis: &DMatrix<f64>, rest: f64, complement: &NullSpace) -> DMatrix<f64> {
        let k = self.coordinates;
        let mut out = DMatrix::zeros(self.dims(), self.dims());
        for b in 0..self.axes.len() {
            out.view_mut((b * k, b * k), (k, k)).copy_from(axis);
        }
        (k * self.axes.len()..self.dims()).for_each(|h| out[(h, h)] = rest);
        complement.project(complement.project(out).transpose())
    }
}

/// Columns in coordinates with white noise and uncorrelated discrepancy.
struct Whitened {
    columns: DMatrix<f64>,
    gp_variance: DVector<f64>,
    log_det_noise: f64,
}

/// Projects out nuisances, whitens the noise and diagonalises the discrepancy.
fn whiten_columns(
    frame: &BasisCache,
    rows: &RowAssembler,
    start: &DMatrix<f64>,
    of: DMatrix<f64>,
) -> Option<Whitened> {
    let complement = NullSpace::of(start)?;
    let mut columns = complement.project(of);
    let mut log_white = 0.0;
    let mut misfit = frame.gp_covariance.as_ref().map(|slow| rows.project_covariance(slow, 0.0, &complement));
    if let Some(white) = &frame.noise_covariance {
        let white = rows.project_covariance(white, 1.0, &complement).cholesky()?;
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

/// Splits columns into parameters, group-level and segment-level random effects.
fn assemble_block(
    simple: Whitened,
    order: &ColumnIndex,
    columns: &RandomDesign,
    (w, segment): (usize, &Segment),
    frame: &BasisCache,
) -> SegmentBlock {
    let column = |c: usize| simple.columns.column(c).into_owned();
    let m = simple.columns.nrows();
    let mut own: Vec<(RandomEffect, DVector<f64>)> = Vec::new();
    let mut group_level: Vec<(RandomEffect, DVector<f64>)> = Vec::new();
    let flies = segment.kind.is_airborne();
    for (k, (place, fresh)) in columns.accelerations.iter().enumerate() {
        match fresh {
            true if flies => own.push((RandomEffect::Acceleration(*place), column(order.acceleration(k)))),
            true => (),
            false if flies => {
                group_level.push((RandomEffect::Acceleration(*place), column(order.acceleration(k))))
            }
            false => group_level.push((RandomEffect::Acceleration(*place), DVector::zeros(m))),
        }
    }
    let renewed =
        columns.contact_resets.iter().enumerate().filter(|_| flies && frame.may_be_reset_by_contact(segment));
    for (k, (c, plausible)) in renewed {
        let at = if *c < order.parameters { *c } else { order.acceleration(*c - order.parameters) };
        own.push((RandomEffect::ContactReset(k), column(at) * *plausible));
    }
    own.extend((0..order.impact_errors).map(|k| (RandomEffect::ImpactNoise, column(order.impact_error(k)))));
    for sizes in &columns.amplitude_directions {
        let all =
            sizes.iter().fold(DVector::zeros(m), |all, (parameter, size)| all + column(*parameter) * *size);
        group_level.push((RandomEffect::Scale, all));
    }
    let beside = |of: &[(RandomEffect, DVector<f64>)]| DMatrix::from_fn(m, of.len(), |i, k| of[k].1[i]);
    let names = |of: &[(RandomEffect, DVector<f64>)]| of.iter().map(|o| o.0).collect();
    SegmentBlock {
        segment: w,
        residual: column(order.residual()),
        jacobian: simple.columns.columns(0, order.acceleration(0)).into_owned(),
        z_group: beside(&group_level),
        z_group_effects: names(&group_level),
        z_segment: beside(&own),
        z_segment_effects: names(&own),
        gp_variance: simple.gp_variance,
        log_det_noise: simple.log_det_noise,
    }
}

/// Response of row `i` to an impact error along the normal (0) or tangent (1), of the size of the approach
/// speed.
pub fn impact_error_response(
    segment: &Segment,
    linearization: &Linearization,
    impact: Option<Impact>,
    way: usize,
    i: usize,
) -> f64 {
    let (Some(met), Some(surface)) = (impact, &segment.surface) else { return 0.0 };
    let Some(point) = segment.observations.get(i / 2) else { return 0.0 };
    let [nx, ny] = surface.normal;
    let along = [[nx, ny], [-ny, nx]][way][i % 2];
    (point.time - met.time).max(0.0)
        * along
        * met.approach
        * linearization.weights[i / 2]
        * linearization.irls_scale
}

/// Orthogonal complement of the nuisance columns.
struct NullSpace {
    basis: QR<f64, Dyn, Dyn>,
    rank: usize,
}

impl NullSpace {
    /// `None` if the complement is empty.
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

    /// Coordinates of every column in the complement.
    fn project(&self, mut of: DMatrix<f64>) -> DMatrix<f64> {
        if self.rank > 0 {
            self.basis.q_tr_mul(&mut of);
        }
        of.rows(self.rank, of.nrows() - self.rank).into_owned()
    }
}

/// Groups of all trials. `linearization`: linearization of a segment with columns for parameters, then
/// [`nuisance_accelerations`], then perturbations; `scales`: of each segment's residuals, in units of the
/// noise.
pub fn groups<'l>(
    data: &SegmentData,
    frames: &[BasisCache],
    linearization: impl Fn(usize) -> Cow<'l, Linearization>,
    columns: &RandomDesign,
    scales: &[f64],
) -> Result<Option<Vec<Group>>> {
    let mut out: Vec<Group> = Vec::new();
    for (w, segment) in data.segments.iter().enumerate().filter(|(w, _)| scales[*w].is_finite()) {
        data.progress.check_stop()?;
        let linearization = linearization(w);
        let Some(block) = segment_block((w, segment), &frames[w], &linearization, columns, scales[w]) else {
            if linearization.residual.iter().all(|r| r.is_finite()) {
                continue;
            }
            return Ok(None);
        };
        let differs = !segment.kind.uses_engine();
        match out.last_mut() {
            Some(last) if last.trial == segment.trial && last.has_random_effects && differs => {
                last.blocks.push(block)
            }
            _ => out.push(Group { trial: segment.trial, blocks: vec![block], has_random_effects: differs }),
        }
    }
    Ok(Some(out))
}

/// Derivative of a segment's coordinates by its observed positions, 1/m (coordinates, two per observation);
/// `None` if all are projected out.
pub fn observation_jacobian(
    segment: (usize, &Segment),
    frame: &BasisCache,
    linearization: &Linearization,
    scale: f64,
) -> Option<DMatrix<f64>> {
    let n = 2 * segment.1.observations.len();
    let mut own = linearization.without_jacobian();
    own.append_columns(n, Some(DMatrix::identity(n, n)));
    let none = RandomDesign {
        parameter_count: 0,
        acceleration_count: 0,
        accelerations: Vec::new(),
        contact_resets: Vec::new(),
        amplitude_directions: Vec::new(),
    };
    segment_block(segment, frame, &own, &none, scale).map(|block| block.jacobian)
}

impl SegmentBlock {
    /// Residual after a step of the parameters.
    pub fn residual_at(&self, step: &DVector<f64>) -> DVector<f64> {
        &self.residual - &self.jacobian * step
    }
}

impl Group {
    /// Squared residual after a step of the parameters, in units of the noise.
    pub fn square_at(&self, step: &DVector<f64>) -> f64 {
        self.blocks.iter().map(|b| b.residual_at(step).norm_squared()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nuisance columns are projected out whatever their scale; lengths in the complement are preserved.
    #[test]
    fn nuisances_are_projected_out() {
        let start = DMatrix::from_fn(6, 3, |i, k| match k {
            0 => 1.0,
            1 => 1e4 * i as f64,
            _ => 0.0,
        });
        let complement = NullSpace::of(&start).unwrap();
        let line = DMatrix::from_fn(6, 1, |i, _| 3.0 - 2.0 * i as f64);
        assert!(complement.project(line).norm() < 1e-9);
        let bend = DMatrix::from_column_slice(6, 1, &[5.0, -1.0, -4.0, -4.0, -1.0, 5.0]);
        let observed = complement.project(bend.clone());
        assert_eq!(observed.nrows(), 4, "a column of nothing takes nothing up");
        assert!((observed.norm() - bend.norm()).abs() < 1e-9);
    }
}
