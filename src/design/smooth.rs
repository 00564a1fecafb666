//! Gaussian-process regression on a world's parameters, and its leave-one-out residuals.
//!
//! A Gaussian process with a linear mean and a squared exponential kernel, with one length scale for each parameter, shared by all
//! targets. The leave-one-out residuals have a closed form: Rasmussen and Williams 2006, equation 5.12.
//!
//! Differences from the source: length scales are chosen from a short list, parameter by parameter, by the leave-one-out residuals
//! instead of the marginal likelihood, which is unreliable for a misspecified kernel.

use nalgebra::{Cholesky, DMatrix};

/// Candidate length scales, in standard deviations of a parameter; infinity makes the function linear in it.
const LENGTH_SCALES: [f64; 4] = [f64::INFINITY, 4.0, 1.5, 0.6];
/// Prior variance of the linear part's slopes, and of the white noise part, relative to the smooth part's variance.
const LINEAR_VARIANCE: f64 = 100.0;
const NUGGET: f64 = 1e-4;

/// (worlds, directions): leave-one-out residuals of the targets. `noise`: known noise variance of each direction.
pub fn leave_one_out_residuals(numbers: &[&[f64]], targets: &DMatrix<f64>, noise: &[f64]) -> DMatrix<f64> {
    let scaled = standardise(numbers);
    let mut lengths = vec![f64::INFINITY; scaled.ncols()];
    let mut best = residuals(&scaled, &lengths, targets);
    let mut worth = total_log_variance(&best, noise);
    for k in 0..lengths.len() {
        for length in LENGTH_SCALES {
            let mut tried = lengths.clone();
            tried[k] = length;
            let found = residuals(&scaled, &tried, targets);
            let own = total_log_variance(&found, noise);
            if own < worth {
                (lengths, best, worth) = (tried, found, own);
            }
        }
    }
    best
}

/// The parameters that vary, each with mean 0 and variance 1, (worlds, parameters).
fn standardise(numbers: &[&[f64]]) -> DMatrix<f64> {
    let (n, d) = (numbers.len(), numbers.first().map_or(0, |p| p.len()));
    let all = DMatrix::from_fn(n, d, |i, k| numbers[i][k]);
    let of = |k: usize| {
        let column = all.column(k);
        let mean = column.mean();
        let spread = (column.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
        (spread > 0.0).then(|| column.map(|v| (v - mean) / spread))
    };
    let varied: Vec<_> = (0..d).filter_map(of).collect();
    if varied.is_empty() { DMatrix::zeros(n, 0) } else { DMatrix::from_columns(&varied) }
}

fn residuals(scaled: &DMatrix<f64>, lengths: &[f64], targets: &DMatrix<f64>) -> DMatrix<f64> {
    let n = scaled.nrows();
    let kernel = DMatrix::from_fn(n, n, |i, j| {
        let (mut straight, mut square) = (1.0, 0.0);
        for (k, length) in lengths.iter().enumerate() {
            straight += scaled[(i, k)] * scaled[(j, k)];
            square += ((scaled[(i, k)] - scaled[(j, k)]) / length).powi(2);
        }
        LINEAR_VARIANCE * straight + libm::exp(-0.5 * square) + if i == j { NUGGET } else { 0.0 }
    });
    let Some(kernel) = Cholesky::new(kernel) else { return targets.clone() };
    let inverse = kernel.inverse();
    let mut left = &inverse * targets;
    for (i, mut row) in left.row_iter_mut().enumerate() {
        row /= inverse[(i, i)];
    }
    left
}

/// Sum over directions of the logarithm of residual variance plus noise.
fn total_log_variance(left: &DMatrix<f64>, noise: &[f64]) -> f64 {
    let n = left.nrows().max(1) as f64;
    let of = |(r, noise): (usize, &f64)| libm::log(left.column(r).norm_squared() / n + noise);
    noise.iter().enumerate().map(of).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng;
    use rand::RngExt;

    /// Linear and saturating dependence (a sliding contact that sticks) is predicted; noise is not.
    #[test]
    fn predicts_smooth_dependence() {
        let mut stream = rng::stream(5, "smooth");
        let mut points = || -> Vec<Vec<f64>> {
            (0..120).map(|_| vec![3.0 + stream.random::<f64>(), 1e-3 * stream.random::<f64>()]).collect()
        };
        let numbers = points();
        let noise = points();
        let targets = DMatrix::from_fn(120, 3, |i, r| match r {
            0 => 50.0 * numbers[i][0] - 2e4 * numbers[i][1],
            1 => 100.0 * (numbers[i][0] - 3.0).min(0.4),
            _ => 100.0 * noise[i][0],
        });
        let own: Vec<&[f64]> = numbers.iter().map(Vec::as_slice).collect();
        let left = leave_one_out_residuals(&own, &targets, &[1.0; 3]);
        let spread = |m: &DMatrix<f64>, r: usize| m.column(r).variance().sqrt();
        let share = |r: usize| spread(&left, r) / spread(&targets, r);
        assert!(share(0) < 0.01, "{}", share(0));
        assert!(share(1) < 0.15, "{}", share(1));
        assert!(share(2) > 0.9, "{}", share(2));
    }

    #[test]
    fn predicts_the_mean_from_constant_parameters() {
        let own = vec![[1.0].as_slice(); 5];
        let targets = DMatrix::from_column_slice(5, 1, &[0.0, 0.0, 5.0, 0.0, 0.0]);
        let left = leave_one_out_residuals(&own, &targets, &[1.0]);
        assert!((left[(2, 0)] - 5.0).abs() < 0.05 && (left[(0, 0)] + 1.25).abs() < 0.05, "{left}");
    }
}
