//! Parts of launches in coordinates in which their covariance under some components is the identity, but for their scale.

use nalgebra::{DMatrix, DVector};

use crate::discover::gaussian::{Components, student};
use crate::discover::launch::Part;

/// A part in coordinates in which its covariance is the identity, but for its scale.
pub struct Whitened {
    /// What the fit leaves.
    pub left: DVector<f64>,
    /// Derivatives by the model's own numbers, and by the functions of a shared field, while they are needed.
    pub slots: DMatrix<f64>,
    pub field: DMatrix<f64>,
    /// Log determinant of the covariance.
    pub log_det: f64,
}

/// A part in coordinates in which its covariance under the components is the identity, and the lower factor that took it there.
pub fn whiten(part: &Part, components: &Components, slots: usize) -> Option<(Whitened, DMatrix<f64>)> {
    let n: usize = part.blocks.iter().map(|b| b.left.len()).sum();
    let extras = part.blocks.first()?.columns.ncols() - slots;
    let (mut covariance, mut log_det) = (DMatrix::zeros(n, n), 0.0);
    let (mut left, mut columns) = (DVector::zeros(n), DMatrix::zeros(n, slots + extras));
    // What windows of a launch have alike: sizes that differ by launch, pushes, strengths.
    let spread = |k: usize| components.spread.get(k).copied().filter(|s| part.differs && *s > 0.0);
    let sizes: Vec<(usize, f64)> = (0..slots).filter_map(|k| spread(k).map(|s| (k, s))).collect();
    let alike = if part.differs { part.blocks[0].alike.ncols() } else { 0 };
    let mut shared = DMatrix::zeros(n, sizes.len() + alike);
    let mut row = 0;
    for block in &part.blocks {
        let m = block.left.len();
        log_det += block.log_white;
        left.rows_mut(row, m).copy_from(&block.left);
        columns.rows_mut(row, m).copy_from(&block.columns.columns(0, slots + extras));
        let mut own = DMatrix::from_diagonal(&block.slow.map(|s| 1.0 + components.slow.powi(2) * s));
        for (k, kind) in block.kinds.iter().enumerate() {
            let column = block.own.column(k) * components.of(*kind);
            own += &column * column.transpose();
        }
        covariance.view_mut((row, row), (m, m)).copy_from(&own);
        for (k, (slot, sd)) in sizes.iter().enumerate() {
            shared.view_mut((row, k), (m, 1)).copy_from(&(block.columns.column(*slot) * *sd));
        }
        for k in 0..alike {
            let sd = components.of(block.alike_of[k]);
            shared.view_mut((row, sizes.len() + k), (m, 1)).copy_from(&(block.alike.column(k) * sd));
        }
        row += m;
    }
    covariance += &shared * shared.transpose();
    let root = covariance.cholesky()?.l();
    log_det += 2.0 * root.diagonal().iter().map(|d| libm::log(*d)).sum::<f64>();
    let left = root.solve_lower_triangular(&left)?;
    let columns = root.solve_lower_triangular(&columns)?;
    let own = |from: usize, count: usize| columns.columns(from, count).into_owned();
    Some((Whitened { left, slots: own(0, slots), field: own(slots, extras), log_det }, root))
}

impl Whitened {
    /// Log density of what is left, its scale integrated out; infinitely little of what is no number.
    pub fn log_density(&self, square: f64) -> f64 {
        if !square.is_finite() {
            return f64::NEG_INFINITY;
        }
        student(square, self.log_det, self.left.len() as f64)
    }
}
