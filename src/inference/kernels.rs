//! Products with covariance matrices of a record, at a cost linear in its length.
//!
//! First-order autoregressive noise, C[i, j] = rho^|i - j|, and a Matern process of smoothness 3/2,
//! K[i, j] = (1 + d) exp(-d) with d = sqrt(3) |t_i - t_j| / length, are Markov processes with one and two states: the
//! contribution of all earlier rows to a row follows from their contribution to the row before. The products are exact.
//!
//! Source: Hartikainen and Sarkka, Kalman filtering and smoothing solutions to temporal Gaussian process regression models
//! (IEEE MLSP 2010), section 3.
//!
//! Differences from the source: products with the covariance, not with its inverse.

use nalgebra::{DMatrix, DVector};

/// C times every column. A row is the sum of a block of `sizes[i]` rows of the record (one in most records), divided
/// by the root of their number, so that all have about the same variance.
pub fn autoregressive(rho: f64, sizes: &[f64], of: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = of.clone();
    if rho == 0.0 {
        return out;
    }
    // By block: its variance, its covariance with the row after it, and the decay of the correlation across it.
    let of_size = |size: &f64| {
        let (size, left) = (size.max(1.0), rho.powi(size.max(1.0) as i32));
        [block_variance(rho, size), rho * (1.0 - left) / ((1.0 - rho) * size.sqrt()), left]
    };
    let blocks: Vec<[f64; 3]> = sizes.iter().map(of_size).collect();
    for (column, mut sums) in of.column_iter().zip(out.column_iter_mut()) {
        let (mut before, mut after) = (0.0, 0.0);
        for (i, [variance, weight, left]) in blocks.iter().enumerate() {
            sums[i] = variance * column[i] + weight * before;
            before = left * before + weight / rho * column[i];
        }
        for (i, [_, weight, left]) in blocks.iter().enumerate().rev() {
            sums[i] += weight * after;
            after = left * after + weight / rho * column[i];
        }
    }
    out
}

/// Variance of the sum of `size` neighbouring rows of unit variance, divided by the root of their number.
pub fn block_variance(rho: f64, size: f64) -> f64 {
    if size <= 1.0 {
        return 1.0;
    }
    (1.0 + rho) / (1.0 - rho) - 2.0 * rho * (1.0 - rho.powi(size as i32)) / (size * (1.0 - rho).powi(2))
}

/// Sum of w_i C[i, j]^2 w_j over all pairs of rows.
pub fn squared_sum(rho: f64, weights: &DVector<f64>) -> f64 {
    let column = DMatrix::from_column_slice(weights.len(), 1, weights.as_slice());
    autoregressive(rho * rho, &vec![1.0; weights.len()], &column).column(0).dot(weights)
}

/// K times every column; `times` of the rows are ascending.
pub fn matern(times: &[f64], length: f64, of: &DMatrix<f64>) -> DMatrix<f64> {
    let n = times.len();
    let gap = |i: usize| 3f64.sqrt() * (times[i + 1] - times[i]) / length;
    let gaps: Vec<[f64; 2]> = (1..n).map(|i| [gap(i - 1), libm::exp(-gap(i - 1))]).collect();
    // Sums over earlier rows of exp(-d) and of d exp(-d) times the column.
    let on = |[plain, sloped]: [f64; 2], [d, decay]: [f64; 2]| [decay * plain, decay * (sloped + d * plain)];
    let mut out = of.clone();
    for (column, mut sums) in of.column_iter().zip(out.column_iter_mut()) {
        let mut before = [0.0; 2];
        for i in 1..n {
            before = on([before[0] + column[i - 1], before[1]], gaps[i - 1]);
            sums[i] += before[0] + before[1];
        }
        let mut after = [0.0; 2];
        for i in (1..n).rev() {
            after = on([after[0] + column[i], after[1]], gaps[i - 1]);
            sums[i - 1] += after[0] + after[1];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uneven times and two columns.
    fn record() -> (Vec<f64>, DMatrix<f64>) {
        let times = (0..50).map(|i| 0.02 * f64::from(i) + 0.004 * libm::sin(f64::from(i))).collect();
        (times, DMatrix::from_fn(50, 2, |i, k| libm::sin((i * i + 7 * k) as f64)))
    }

    #[test]
    fn products_equal_dense_products() {
        let (times, columns) = record();
        for rho in [-0.4, 0.0, 0.7] {
            let whole = DMatrix::from_fn(50, 50, |i, j| f64::powi(rho, i.abs_diff(j) as i32));
            assert!((autoregressive(rho, &[1.0; 50], &columns) - &whole * &columns).amax() < 1e-12, "{rho}");
            let weights = columns.column(0).into_owned();
            let squares = whole.map(|c| c * c);
            assert!((squared_sum(rho, &weights) - weights.dot(&(squares * &weights))).abs() < 1e-12);
        }
        for length in [0.01, 0.25, 20.0] {
            let whole = DMatrix::from_fn(50, 50, |i, j| {
                let d = 3f64.sqrt() * (times[i] - times[j]).abs() / length;
                (1.0 + d) * libm::exp(-d)
            });
            assert!((matern(&times, length, &columns) - &whole * &columns).amax() < 1e-12, "{length}");
        }
    }

    /// Compares with dense sums of up to eight rows.
    #[test]
    fn blocks_are_normalised_sums_of_rows() {
        let sizes = [1usize, 5, 8, 0, 3, 1];
        let rows: Vec<usize> = sizes.iter().enumerate().flat_map(|(b, n)| vec![b; *n.max(&1)]).collect();
        let sums = DMatrix::from_fn(6, rows.len(), |b, i| {
            if rows[i] == b { (sizes[b].max(1) as f64).sqrt().recip() } else { 0.0 }
        });
        let columns = DMatrix::from_fn(6, 2, |i, k| libm::sin((i * i + 7 * k) as f64));
        for rho in [-0.4, 0.7] {
            let whole = DMatrix::from_fn(rows.len(), rows.len(), |i, j| f64::powi(rho, i.abs_diff(j) as i32));
            let expected = &sums * whole * sums.transpose() * &columns;
            let found = autoregressive(rho, &sizes.map(|s| s as f64), &columns);
            assert!((found - expected).amax() < 1e-12, "{rho}");
        }
    }

    #[test]
    fn records_of_at_most_one_row_are_unchanged() {
        for n in [0, 1] {
            let column = DMatrix::from_element(n, 1, 2.0);
            assert_eq!(matern(&vec![0.5; n], 0.1, &column), column);
            assert_eq!(autoregressive(0.5, &vec![1.0; n], &column), column);
        }
    }
}
