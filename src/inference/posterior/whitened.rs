//! Whitened groups: residuals with identity covariance, up to scale, given variance components.

use nalgebra::{DMatrix, DVector};

use crate::inference::mixed_model::group_statistics::{VarianceComponents, student_log_density};
use crate::inference::mixed_model::groups::Group;

/// A group whitened by its covariance, up to scale.
pub struct WhitenedGroup {
    /// Residual at the fit.
    pub residual: DVector<f64>,
    /// Jacobian with respect to the parameters; dropped when no longer needed.
    pub jacobian: DMatrix<f64>,
    pub field_jacobian: DMatrix<f64>,
    /// Log determinant of the covariance.
    pub log_det: f64,
}

/// Whitens a group given variance components; also returns the lower Cholesky factor.
pub fn whiten(
    group: &Group,
    components: &VarianceComponents,
    parameter_count: usize,
) -> Option<(WhitenedGroup, DMatrix<f64>)> {
    let n: usize = group.blocks.iter().map(|b| b.residual.len()).sum();
    let basis_count = group.blocks.first()?.jacobian.ncols() - parameter_count;
    let (mut covariance, mut log_det) = (DMatrix::zeros(n, n), 0.0);
    let (mut residual, mut columns) = (DVector::zeros(n), DMatrix::zeros(n, parameter_count + basis_count));
    // Random effects shared by the segments of a trial: nuisance accelerations and scales.
    let shared_columns = if group.has_random_effects { group.blocks[0].z_group.ncols() } else { 0 };
    let mut shared = DMatrix::zeros(n, shared_columns);
    let mut row = 0;
    for block in &group.blocks {
        let m = block.residual.len();
        log_det += block.log_det_noise;
        residual.rows_mut(row, m).copy_from(&block.residual);
        columns.rows_mut(row, m).copy_from(&block.jacobian.columns(0, parameter_count + basis_count));
        let mut block_covariance =
            DMatrix::from_diagonal(&block.gp_variance.map(|s| 1.0 + components.discrepancy.powi(2) * s));
        for (k, kind) in block.z_segment_effects.iter().enumerate() {
            let column = block.z_segment.column(k) * components.sd_of(*kind);
            block_covariance += &column * column.transpose();
        }
        covariance.view_mut((row, row), (m, m)).copy_from(&block_covariance);
        for k in 0..shared_columns {
            let sd = components.sd_of(block.z_group_effects[k]);
            shared.view_mut((row, k), (m, 1)).copy_from(&(block.z_group.column(k) * sd));
        }
        row += m;
    }
    covariance += &shared * shared.transpose();
    let root = covariance.cholesky()?.l();
    log_det += 2.0 * root.diagonal().iter().map(|d| libm::log(*d)).sum::<f64>();
    let residual = root.solve_lower_triangular(&residual)?;
    let columns = root.solve_lower_triangular(&columns)?;
    let columns_of = |from: usize, count: usize| columns.columns(from, count).into_owned();
    Some((
        WhitenedGroup {
            residual,
            jacobian: columns_of(0, parameter_count),
            field_jacobian: columns_of(parameter_count, basis_count),
            log_det,
        },
        root,
    ))
}

impl WhitenedGroup {
    /// Student t log density of the residual with squared norm `square`; minus infinity if not finite.
    pub fn log_density(&self, square: f64) -> f64 {
        if !square.is_finite() {
            return f64::NEG_INFINITY;
        }
        student_log_density(square, self.log_det, self.residual.len() as f64)
    }
}
