//! Statistics and linear algebra.
//!
//! Student's t by Fisher's F (Abramowitz and Stegun 26.7.1).

use crate::distribution::f_survival;
use nalgebra::{DMatrix, DVector};

/// Decrease of a profile log density that excludes a value, nats: half the 95 % quantile of chi-squared with one degree of
/// freedom.
pub const EXCLUSION_NATS: f64 = 1.92;

/// P(T > t), one-sided, Student with `freedom` degrees.
pub fn t_survival(t: f64, freedom: f64) -> f64 {
    let half = 0.5 * f_survival(t * t, 1.0, freedom);
    if t > 0.0 { half } else { 1.0 - half }
}

/// P(Z > z) of the normal distribution.
pub fn normal_survival(z: f64) -> f64 {
    0.5 * libm::erfc(z / std::f64::consts::SQRT_2)
}

/// Probability of at least `k` successes in `n` trials, each with probability `share`, which is neither 0 nor 1.
pub fn binomial_survival(k: usize, n: usize, share: f64) -> f64 {
    let (n, odds) = (n as f64, libm::log(share / (1.0 - share)));
    let log_of = |i: f64| {
        libm::lgamma(n + 1.0) - libm::lgamma(i + 1.0) - libm::lgamma(n - i + 1.0)
            + i * odds
            + n * libm::log(1.0 - share)
    };
    (k..=n as usize).map(|i| libm::exp(log_of(i as f64))).sum::<f64>().min(1.0)
}

/// Mean and its standard error; the error is infinite below two values.
pub fn mean_and_error(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n.max(1.0);
    if values.len() < 2 {
        return (mean, f64::INFINITY);
    }
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// Least-squares slope of points (t, y); `None` without points or if all t are equal.
pub fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let (t, y) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let up: f64 = points.iter().map(|p| (p.0 - t) * (p.1 - y)).sum();
    let down: f64 = points.iter().map(|p| (p.0 - t).powi(2)).sum();
    (down > 0.0).then(|| up / down)
}

/// Median; 0 without values.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}

/// Fixes a parameter in normal equations.
pub fn fix_parameter(gram: &mut DMatrix<f64>, score: &mut DVector<f64>, number: usize) {
    gram.row_mut(number).fill(0.0);
    gram.column_mut(number).fill(0.0);
    score[number] = 0.0;
}

/// Solves `a x = b` for a symmetric positive semidefinite `a`; directions without information stay at 0.
pub fn solve(a: &DMatrix<f64>, b: &DVector<f64>) -> DVector<f64> {
    pseudo_inverse(a) * b
}

/// Pseudo-inverse of a symmetric positive semidefinite matrix, scaled to a unit diagonal first.
pub fn pseudo_inverse(a: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    if n == 0 {
        return DMatrix::zeros(0, 0);
    }
    let scale = DVector::from_fn(n, |i, _| if a[(i, i)] > 0.0 { 1.0 / a[(i, i)].sqrt() } else { 0.0 });
    let scaled = DMatrix::from_fn(n, n, |i, j| a[(i, j)] * scale[i] * scale[j]);
    if !scaled.iter().all(|v| v.is_finite()) {
        return DMatrix::zeros(n, n);
    }
    let eigen = scaled.symmetric_eigen();
    let mut out = DMatrix::zeros(n, n);
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        if *value > 1e-10 {
            let v = eigen.eigenvectors.column(k);
            out += v * v.transpose() / *value;
        }
    }
    DMatrix::from_fn(n, n, |i, j| out[(i, j)] * scale[i] * scale[j])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slope_of_a_line_is_exact() {
        let line = [(1.0, 5.0), (2.0, 3.0), (4.0, -1.0)];
        assert!((slope(&line).unwrap() + 2.0).abs() < 1e-12);
        assert_eq!((slope(&[]), slope(&line[..1]), slope(&[(1.0, 0.0), (1.0, 9.0)])), (None, None, None));
    }

    #[test]
    fn binomial_tails_match_sums_by_hand() {
        // 1 - 0.8^5, and 5 * 0.2^4 * 0.8 + 0.2^5.
        assert!((binomial_survival(1, 5, 0.2) - 0.672_32).abs() < 1e-12);
        assert!((binomial_survival(4, 5, 0.2) - 0.006_72).abs() < 1e-12);
        assert_eq!((binomial_survival(0, 9, 0.5), binomial_survival(3, 2, 0.5)), (1.0, 0.0));
    }

    #[test]
    fn reference_values_are_reproduced() {
        // Standard tables: F(1, 10) 5 % 4.965, F(3, 20) 1 % 4.938; t(13) 2.5 % 2.160; normal 2.5 % 1.96.
        assert!((f_survival(4.965, 1.0, 10.0) - 0.05).abs() < 1e-4);
        assert!((f_survival(4.938, 3.0, 20.0) - 0.01).abs() < 1e-4);
        assert!((t_survival(2.160, 13.0) - 0.025).abs() < 1e-4);
        assert!((normal_survival(1.959_964) - 0.025).abs() < 1e-6);
    }

    #[test]
    fn unidentified_directions_stay_zero() {
        let a = DMatrix::from_row_slice(2, 2, &[4.0, 0.0, 0.0, 0.0]);
        let x = solve(&a, &DVector::from_vec(vec![2.0, 0.0]));
        assert_eq!((x[0], x[1]), (0.5, 0.0));
    }
}
