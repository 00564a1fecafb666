//! Distributions and small linear algebra that judging needs.
//!
//! Sources: regularised incomplete beta by Lentz's continued fraction, incomplete gamma by series and fraction
//! (Abramowitz and Stegun 26.5.8, 6.5.29, 6.5.31); leverage-corrected cluster covariance by the jackknife ("CR3":
//! MacKinnon and White, J. Econometrics 29 (1985) 305; Bell and McCaffrey, Survey Methodology 28 (2002) 169).

use libm::{exp, lgamma, log};
use nalgebra::{DMatrix, DVector};

/// P(F > f) for `a` and `b` degrees of freedom; 1 where they are not positive.
pub fn f_above(f: f64, a: f64, b: f64) -> f64 {
    if !(a > 0.0 && b > 0.0) || f.is_nan() {
        return 1.0;
    }
    if f <= 0.0 { 1.0 } else { beta(b / 2.0, a / 2.0, b / (b + a * f)) }
}

/// P(T > t), one-sided, Student with `freedom` degrees.
pub fn t_above(t: f64, freedom: f64) -> f64 {
    let half = 0.5 * f_above(t * t, 1.0, freedom);
    if t > 0.0 { half } else { 1.0 - half }
}

/// t with P(|T| > t) = `outside`.
pub fn t_quantile(outside: f64, freedom: f64) -> f64 {
    if freedom < 1.0 {
        return f64::INFINITY;
    }
    let (mut low, mut high) = (0.0, 1e6);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if f_above(middle * middle, 1.0, freedom) > outside { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// P(Z > z) of the normal distribution.
pub fn normal_above(z: f64) -> f64 {
    0.5 * libm::erfc(z / std::f64::consts::SQRT_2)
}

/// Mean and its standard error; the error is infinite below two values.
pub fn mean_error(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n.max(1.0);
    if values.len() < 2 {
        return (mean, f64::INFINITY);
    }
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// Slope of the straight line through points (t, y) by least squares; `None` of nothing, and where all t are the same.
pub fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let (t, y) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let up: f64 = points.iter().map(|p| (p.0 - t) * (p.1 - y)).sum();
    let down: f64 = points.iter().map(|p| (p.0 - t).powi(2)).sum();
    (down > 0.0).then(|| up / down)
}

/// The middle value; 0 of nothing.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}

/// Solves `a x = b` for a symmetric positive semidefinite `a`; directions without information stay at 0.
pub fn solve(a: &DMatrix<f64>, b: &DVector<f64>) -> DVector<f64> {
    inverse(a) * b
}

/// Pseudo-inverse of a symmetric positive semidefinite matrix, scaled to a unit diagonal first.
pub fn inverse(a: &DMatrix<f64>) -> DMatrix<f64> {
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

/// The regularised incomplete beta function.
fn beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    let front = exp(lgamma(a + b) - lgamma(a) - lgamma(b) + a * log(x) + b * log(1.0 - x));
    if x < (a + 1.0) / (a + b + 2.0) {
        front * fraction(a, b, x) / a
    } else {
        1.0 - front * fraction(b, a, 1.0 - x) / b
    }
}

fn fraction(a: f64, b: f64, x: f64) -> f64 {
    let floor = |v: f64| if v.abs() < 1e-300 { 1e-300 } else { v };
    let (mut c, mut d) = (1.0, 1.0 / floor(1.0 - (a + b) * x / (a + 1.0)));
    let mut h = d;
    for m in 1..400 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        d = 1.0 / floor(1.0 + even * d);
        c = floor(1.0 + even / c);
        h *= d * c;
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        d = 1.0 / floor(1.0 + odd * d);
        c = floor(1.0 + odd / c);
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-14 {
            break;
        }
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_is_that_of_the_line() {
        let line = [(1.0, 5.0), (2.0, 3.0), (4.0, -1.0)];
        assert!((slope(&line).unwrap() + 2.0).abs() < 1e-12);
        assert_eq!((slope(&[]), slope(&line[..1]), slope(&[(1.0, 0.0), (1.0, 9.0)])), (None, None, None));
    }

    #[test]
    fn tables_are_met() {
        // Any table: F(1, 10) 5 % 4.965, F(3, 20) 1 % 4.938; t(13) 2.5 % 2.160; normal 2.5 % 1.96.
        assert!((f_above(4.965, 1.0, 10.0) - 0.05).abs() < 1e-4);
        assert!((f_above(4.938, 3.0, 20.0) - 0.01).abs() < 1e-4);
        assert!((t_above(2.160, 13.0) - 0.025).abs() < 1e-4);
        assert!((t_quantile(0.05, 13.0) - 2.160).abs() < 1e-3);
        assert!((normal_above(1.959_964) - 0.025).abs() < 1e-6);
    }

    #[test]
    fn solving_leaves_what_is_not_told_at_zero() {
        let a = DMatrix::from_row_slice(2, 2, &[4.0, 0.0, 0.0, 0.0]);
        let x = solve(&a, &DVector::from_vec(vec![2.0, 0.0]));
        assert_eq!((x[0], x[1]), (0.5, 0.0));
    }
}
