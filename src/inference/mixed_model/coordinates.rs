//! Coordinates of a segment that are the same for every model: observations are projected on smoothing
//! polynomials (or, with few observations, kept as they are), noise is whitened, and the covariance of the trial
//! discrepancy diagonalised.
//!
//! Source: generalised symmetric eigenproblem (Golub and Van Loan, Matrix Computations (2013), 8.7).

use std::collections::HashMap;

use nalgebra::{DMatrix, DVector};

use crate::inference::data::noise::{self, Noise};
use crate::inference::kernels;
use crate::inference::segment::{Segment, SegmentKind};

/// Length scale of the trial discrepancy (Matern 3/2), as a share of the median duration of flights and rolls.
const GP_LENGTH_SHARE: f64 = 0.25;
/// Number of observations after which noise is not correlated.
const UNCORRELATED_DISTANCE: usize = 100_000;
/// Norm of a column beside the others, relative to its own, below which it depends on them.
const DEPENDENT: f64 = 1e-9;

/// Coordinates of a segment, the same along both axes.
#[derive(Clone)]
pub struct SegmentCoordinates {
    /// Projection (coordinates, observations): smoothing polynomials, or the used observations.
    basis: DMatrix<f64>,
    /// From projected to white coordinates, and the product of both; `None` if projected ones are white.
    whitening: Option<[DMatrix<f64>; 2]>,
    /// Covariance of the unit trial discrepancy in projected coordinates (`None`: none), and its variances in white ones.
    gp_covariance: Option<DMatrix<f64>>,
    gp_variance: DVector<f64>,
    /// Log determinant of the noise covariance along an axis, in projected coordinates.
    log_det_noise: f64,
    /// Axes along which the position varies; a constant coordinate is not used.
    axes: Vec<usize>,
    /// Indices of the nuisances along other axes, which nothing observes.
    unobserved_nuisances: Vec<usize>,
    /// Whether an earlier flight of its trial exists.
    follows_flight: bool,
}

/// Nuisances of a segment in white coordinates.
pub struct WhiteNuisances {
    /// Orthonormal basis (coordinates, rank).
    pub basis: DMatrix<f64>,
    /// Log determinant of the noise covariance in the complement of the nuisances in projected coordinates.
    pub log_det_noise: f64,
}

/// Coordinates of all segments.
pub fn segment_coordinates(segments: &[Segment], noise: &Noise) -> Vec<SegmentCoordinates> {
    let smooth = segments.iter().filter(|w| matches!(w.kind, SegmentKind::Flight | SegmentKind::Rolling));
    let durations: Vec<f64> = smooth.map(|w| w.observations.last().map_or(0.0, |p| p.time)).collect();
    let length = GP_LENGTH_SHARE * crate::inference::statistics::median(&durations).max(1e-6);
    let mut first: HashMap<usize, f64> = HashMap::new();
    for flight in segments.iter().filter(|w| w.kind == SegmentKind::Flight) {
        let start = first.entry(flight.trial).or_insert(flight.start);
        *start = start.min(flight.start);
    }
    let after = |w: &Segment| first.get(&w.trial).is_some_and(|start| *start < w.start);
    segments.iter().map(|w| SegmentCoordinates::of(w, noise, length, after(w))).collect()
}

impl SegmentCoordinates {
    fn of(segment: &Segment, noise: &Noise, length: f64, follows_flight: bool) -> SegmentCoordinates {
        let points = &segment.observations;
        let varies = |a: &usize| points.iter().any(|p| p.position[*a] != points[0].position[*a]);
        let axes: Vec<usize> = (0..2).filter(|a| segment.kind.uses_engine() || varies(a)).collect();
        let is_unobserved =
            |k: &usize| segment.kind.axis_of_nuisance(*k).is_some_and(|axis| !axes.contains(&axis));
        let unobserved_nuisances = (0..segment.nuisances.len()).filter(is_unobserved).collect();
        let times: Vec<f64> = points.iter().map(|p| p.time).collect();
        let sizes: Vec<f64> = points.iter().map(|p| p.weight).collect();
        // Rows are in units of their own noise: a mean of several observations has less.
        let weights: Vec<f64> = sizes.iter().map(|size| size.sqrt()).collect();
        let rho = if segment.kind.uses_engine() { 0.0 } else { noise.rho };
        let observations = points.len() + segment.within_blocks.merged_count;
        let polynomials =
            segment.smooth.as_ref().and_then(|_| noise::polynomial_basis(&times, &weights, observations));
        let (basis, noise_covariance, gp_covariance) = match polynomials {
            Some(q) => (
                q.transpose(),
                (rho != 0.0).then(|| q.tr_mul(&kernels::autoregressive(rho, &sizes, &q))),
                Some(discrepancy_covariance(&times, &weights, length, &q)),
            ),
            None => {
                // Unused observations are no coordinates.
                let counted: Vec<usize> = (0..points.len()).filter(|i| weights[*i] > 0.0).collect();
                let basis = DMatrix::from_fn(counted.len(), points.len(), |k, i| f64::from(counted[k] == i));
                // The noise of one body is independent of another's.
                let places: Vec<usize> =
                    counted.iter().map(|i| i + points[*i].body * UNCORRELATED_DISTANCE).collect();
                (basis, (rho != 0.0).then(|| noise::ar1_correlation(&places, rho)), None)
            }
        };
        let (whitening, gp_variance, log_det_noise) = diagonalise(noise_covariance, gp_covariance.as_ref());
        SegmentCoordinates {
            whitening: whitening.map(|map| [&map * &basis, map]),
            gp_variance: gp_variance.unwrap_or_else(|| DVector::zeros(basis.nrows())),
            basis,
            gp_covariance,
            log_det_noise,
            axes,
            unobserved_nuisances,
            follows_flight,
        }
    }

    /// White coordinates of columns with two rows per observation (x and y), then two per pseudo-observation, the second of
    /// which is empty: axis by axis, then the pseudo-observations. `scales`: of both kinds of rows.
    pub fn white(&self, columns: &DMatrix<f64>, scales: [f64; 2]) -> DMatrix<f64> {
        self.along_axes(self.whitening.as_ref().map_or(&self.basis, |[whole, _]| whole), columns, scales)
    }

    /// The span of the nuisances' columns, with the same rows; `None` if it holds all coordinates.
    pub fn white_nuisances(&self, columns: &DMatrix<f64>, scales: [f64; 2]) -> Option<WhiteNuisances> {
        // The responses of unobserved ones along the used axes are rounding errors.
        let observed =
            self.along_axes(&self.basis, columns, scales).remove_columns_at(&self.unobserved_nuisances);
        let (projected, _) = orthonormalise(&observed);
        if projected.ncols() == projected.nrows() {
            return None;
        }
        let Some([_, map]) = &self.whitening else {
            return Some(WhiteNuisances { basis: projected, log_det_noise: 0.0 });
        };
        let (k, mut white) = (map.nrows(), projected.clone());
        for b in 0..self.axes.len() {
            white.rows_mut(b * k, k).copy_from(&(map * projected.rows(b * k, k)));
        }
        let (basis, log_norms) = orthonormalise(&white);
        let log_det_noise = self.axes.len() as f64 * self.log_det_noise + 2.0 * log_norms;
        Some(WhiteNuisances { basis, log_det_noise })
    }

    /// Variances of the unit trial discrepancy, for `count` coordinates.
    pub fn gp_variances(&self, count: usize) -> DVector<f64> {
        let k = self.gp_variance.len();
        DVector::from_fn(count, |i, _| if i < k * self.axes.len() { self.gp_variance[i % k] } else { 0.0 })
    }

    /// Covariance of the unit trial discrepancy at the segment's observations, in two factors: the covariance in
    /// coordinates times the basis (coordinates, observations), and the basis; `None` if there is none.
    pub fn gp_covariance_at_observations(&self) -> Option<(DMatrix<f64>, &DMatrix<f64>)> {
        self.gp_covariance.as_ref().map(|slow| (slow * &self.basis, &self.basis))
    }

    /// Whether the segment moves along both axes.
    pub fn moves_in_plane(&self) -> bool {
        self.axes.len() == 2
    }

    /// Whether a contact may have reset random accelerations of the segment.
    pub fn may_be_reset_by_contact(&self, segment: &Segment) -> bool {
        self.follows_flight || segment.kind.is_impact()
    }

    fn along_axes(&self, map: &DMatrix<f64>, columns: &DMatrix<f64>, scales: [f64; 2]) -> DMatrix<f64> {
        let (k, n) = map.shape();
        let (count, pseudo_observations) = (k * self.axes.len(), (columns.nrows() - 2 * n) / 2);
        let mut out = DMatrix::zeros(count + pseudo_observations, columns.ncols());
        for (b, axis) in self.axes.iter().enumerate() {
            let rows = DMatrix::from_fn(n, columns.ncols(), |i, c| scales[0] * columns[(2 * i + axis, c)]);
            out.rows_mut(b * k, k).copy_from(&(map * rows));
        }
        for h in 0..pseudo_observations {
            out.row_mut(count + h).copy_from(&(columns.row(2 * n + 2 * h) * scales[1]));
        }
        out
    }
}

/// Covariance of the unit trial discrepancy in the coordinates of `basis`, in units of the noise of each
/// observation.
fn discrepancy_covariance(times: &[f64], weights: &[f64], length: f64, basis: &DMatrix<f64>) -> DMatrix<f64> {
    let rows = DMatrix::from_fn(basis.nrows(), basis.ncols(), |i, k| weights[i] * basis[(i, k)]);
    rows.tr_mul(&kernels::matern(times, length, &rows))
}

/// The map to coordinates where noise is white and the discrepancy diagonal (`None`: the identity), the discrepancy's
/// variances there, and the log determinant of the noise. An absent noise covariance is the identity.
fn diagonalise(
    noise: Option<DMatrix<f64>>,
    discrepancy: Option<&DMatrix<f64>>,
) -> (Option<DMatrix<f64>>, Option<DVector<f64>>, f64) {
    let root = noise.and_then(|noise| noise.cholesky()).map(|factor| factor.l());
    let inverse =
        root.and_then(|root| root.solve_lower_triangular(&DMatrix::identity(root.nrows(), root.nrows())));
    let log_det = inverse.as_ref().map_or(0.0, |i| -2.0 * i.diagonal().iter().map(|d| d.ln()).sum::<f64>());
    let Some(discrepancy) = discrepancy else { return (inverse, None, log_det) };
    let white = match &inverse {
        Some(inverse) => inverse * discrepancy * inverse.transpose(),
        None => discrepancy.clone(),
    };
    let eigen = (0.5 * (&white + white.transpose())).symmetric_eigen();
    let turn = eigen.eigenvectors.transpose();
    let map = match inverse {
        Some(inverse) => turn * inverse,
        None => turn,
    };
    (Some(map), Some(eigen.eigenvalues.map(|v| v.max(0.0))), log_det)
}

/// Orthonormal basis of the span of some columns, and the sum of the logarithms of the norms that remain of each beside
/// those before it; dependent columns are left out (Gram and Schmidt, twice).
pub fn orthonormalise(columns: &DMatrix<f64>) -> (DMatrix<f64>, f64) {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let mut log_norms = 0.0;
    for column in columns.column_iter() {
        let size = column.norm();
        let mut rest = column.into_owned();
        for _ in 0..2 {
            for b in &basis {
                let along = b.dot(&rest);
                rest.axpy(-along, b, 1.0);
            }
        }
        let norm = rest.norm();
        if norm > DEPENDENT * size && size > 0.0 {
            log_norms += norm.ln();
            basis.push(rest / norm);
        }
    }
    (DMatrix::from_fn(columns.nrows(), basis.len(), |i, k| basis[k][i]), log_norms)
}

/// Columns without their parts in the span of an orthonormal basis.
pub fn project_out(basis: &DMatrix<f64>, columns: &DMatrix<f64>) -> DMatrix<f64> {
    columns - basis * basis.tr_mul(columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dependent columns are left out whatever their scale.
    #[test]
    fn dependent_columns_are_left_out() {
        let columns = DMatrix::from_fn(6, 4, |i, k| match k {
            0 => 1.0,
            1 => 1e4 * i as f64,
            2 => 0.0,
            _ => 3.0 - 2.0 * i as f64,
        });
        let (basis, log_norms) = orthonormalise(&columns);
        assert_eq!(basis.ncols(), 2);
        assert!((basis.tr_mul(&basis) - DMatrix::identity(2, 2)).amax() < 1e-12);
        assert!((log_norms - (6f64.sqrt() * 1e4 * 17.5f64.sqrt()).ln()).abs() < 1e-9);
    }

    /// In the new coordinates noise is white and the discrepancy diagonal.
    #[test]
    fn both_covariances_become_diagonal() {
        let noise = DMatrix::from_fn(5, 5, |i, j| f64::powi(0.4, i.abs_diff(j) as i32));
        let discrepancy = DMatrix::from_fn(5, 5, |i, j| libm::exp(-0.1 * (i as f64 - j as f64).powi(2)));
        let (map, variances, log_det) = diagonalise(Some(noise.clone()), Some(&discrepancy));
        let (map, variances) = (map.unwrap(), variances.unwrap());
        let turned = |of: &DMatrix<f64>| &map * of * map.transpose();
        assert!((turned(&noise) - DMatrix::identity(5, 5)).amax() < 1e-12);
        assert!((turned(&discrepancy) - DMatrix::from_diagonal(&variances)).amax() < 1e-12);
        assert!((log_det - noise.determinant().ln()).abs() < 1e-12);
    }
}
