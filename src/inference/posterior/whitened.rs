//! Whitened groups: residuals with identity covariance, up to scale, given variance components.

use nalgebra::{DMatrix, DVector};

use crate::inference::mixed_model::group_statistics::{VarianceComponents, student_log_density};
use crate::inference::mixed_model::groups::{Group, SegmentBlock};

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
    let n: usize = group.blocks.iter().map(SegmentBlock::count).sum();
    let basis_count = group.blocks.first()?.jacobian.ncols() - parameter_count;
    let (mut covariance, mut log_det) = (DMatrix::zeros(n, n), 0.0);
    let (mut residual, mut columns) = (DVector::zeros(n), DMatrix::zeros(n, parameter_count + basis_count));
    // Random effects shared by the segments of a trial: nuisance accelerations and scales.
    let shared_columns = if group.has_random_effects { group.blocks[0].z_group.ncols() } else { 0 };
    let mut shared = DMatrix::zeros(n, shared_columns);
    let mut row = 0;
    for block in &group.blocks {
        let m = block.count();
        log_det += block.log_det_noise;
        let free = |of: DMatrix<f64>| block.complement(of);
        let left = DMatrix::from_column_slice(block.residual.len(), 1, block.residual.as_slice());
        residual.rows_mut(row, m).copy_from(&free(left).column(0));
        let fixed = block.jacobian.columns(0, parameter_count + basis_count).into_owned();
        columns.rows_mut(row, m).copy_from(&free(fixed));
        let variances = DMatrix::from_diagonal(&block.variances(components.discrepancy));
        let mut block_covariance = free(free(variances).transpose());
        let z_segment = free(block.z_segment.clone());
        for (k, kind) in block.z_segment_effects.iter().enumerate() {
            let column = z_segment.column(k) * components.sd_of(*kind);
            block_covariance += &column * column.transpose();
        }
        covariance.view_mut((row, row), (m, m)).copy_from(&block_covariance);
        let z_group = free(block.z_group.clone());
        for k in 0..shared_columns {
            let sd = components.sd_of(block.z_group_effects[k]);
            shared.view_mut((row, k), (m, 1)).copy_from(&(z_group.column(k) * sd));
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
