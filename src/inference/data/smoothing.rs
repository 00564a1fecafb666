//! Polynomial smoothing: a polynomial of ample degree for each coordinate of a flight, fitted robustly. Its
//! residuals are noise or outliers.

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
use crate::inference::statistics::{median, pseudo_inverse};
use crate::progress::Progress;

/// Multiples of the robust standard deviation beyond which a point is an outlier: 7 in a million for normal
/// noise.
const OUTLIER_SCALES: f64 = 4.5;
/// Number of neighbours used to test an observation.
const NEIGHBOURS: usize = 6;

/// Time on the trial's clock, s, and observed position, m.
pub type TimedPosition = (f64, [f64; 2]);

/// A flight's polynomial fit.
#[derive(Clone, Debug)]
pub struct PolynomialSmooth {
    /// Residuals of x and y, m; 0 at outliers.
    pub residual: [Vec<f64>; 2],
    /// Which rows are not outliers.
    pub is_inlier: Vec<bool>,
    /// Number of coordinates that vary at all: a recording of heights alone has one.
    pub axes: f64,
    /// Orthonormal polynomial basis over the inliers (rows, polynomials).
    pub basis: DMatrix<f64>,
    /// Coefficients of the Chebyshev polynomials of x and y, m, and the first and last time, s.
    pub coefficients: [DVector<f64>; 2],
    pub span: [f64; 2],
}

impl PolynomialSmooth {
    /// Smooth position along an axis at a time on the trial's clock, m.
    pub fn value(&self, axis: usize, time: f64) -> f64 {
        let of = |(k, c): (usize, &f64)| c * chebyshev(k, self.span, time);
        self.coefficients[axis].iter().enumerate().map(of).sum()
    }
}

/// Chebyshev polynomial of degree `k` over a span of times.
fn chebyshev(k: usize, [first, last]: [f64; 2], time: f64) -> f64 {
    let u = 2.0 * (time - first) / (last - first).max(1e-12) - 1.0;
    libm::cos(k as f64 * libm::acos(u.clamp(-1.0, 1.0)))
}

/// Fits a flight's rows.
pub fn fit_polynomials(rows: &[TimedPosition], progress: &dyn Progress) -> Result<PolynomialSmooth> {
    let n = rows.len();
    let degree = degree(n);
    let span = [rows[0].0, rows[n - 1].0];
    let full = DMatrix::from_fn(n, degree + 1, |i, k| chebyshev(k, span, rows[i].0));
    let mut used = vec![true; n];
    let mut fitted = DMatrix::zeros(n, 0);
    let mut residual = [vec![0.0; n], vec![0.0; n]];
    let mut coefficients = [DVector::zeros(degree + 1), DVector::zeros(degree + 1)];
    for pass in 0..12 {
        progress.check_stop()?;
        let basis = DMatrix::from_fn(n, degree + 1, |i, k| if used[i] { full[(i, k)] } else { 0.0 });
        let Some(q) = orthonormal_basis(&basis) else { break };
        fitted = q;
        let leverages: Vec<f64> =
            (0..n).map(|i| (1.0 - fitted.row(i).norm_squared()).max(0.05).sqrt()).collect();
        let mut scaled = vec![0.0f64; n];
        for (axis, residual) in residual.iter_mut().enumerate() {
            let y = DVector::from_fn(n, |i, _| rows[i].1[axis]);
            let mean = y.mean();
            let centred = y.map(|v| v - mean);
            // Rejected rows are tested again against the fit to the others.
            let beta = (&basis.transpose() * &basis).pseudo_inverse(1e-12).ok();
            let Some(inverse) = beta else { continue };
            coefficients[axis] = inverse * basis.transpose() * &centred;
            let fit = &full * &coefficients[axis];
            coefficients[axis][0] += mean;
            let off: Vec<f64> = (0..n).map(|i| centred[i] - fit[i]).collect();
            let sizes: Vec<f64> = (0..n).filter(|i| used[*i]).map(|i| off[i].abs()).collect();
            let share = (1.0 - (degree + 1) as f64 / n as f64).max(0.2);
            // Quantised positions can have zero as the median residual: the mean size guards against that.
            let usual = sizes.iter().sum::<f64>() / sizes.len().max(1) as f64;
            let scale = ((1.4826 * median(&sizes)).max(0.6 * usual) / share.sqrt()).max(1e-9);
            for i in 0..n {
                let leverage = if used[i] { leverages[i] } else { 1.0 };
                scaled[i] = scaled[i].max(off[i].abs() / scale / leverage);
                residual[i] = if used[i] { off[i] } else { 0.0 };
            }
        }
        // The worst first: one large outlier bends the fit and makes its neighbours look bad.
        let worst = (0..n).filter(|i| used[*i]).map(|i| scaled[i]).fold(0.0, f64::max);
        let limit = OUTLIER_SCALES.max(0.5 * worst);
        let left = used.iter().filter(|k| **k).count();
        let out: Vec<usize> = (0..n).filter(|i| used[*i] && scaled[*i] > limit).collect();
        if out.is_empty() || pass == 11 || left - out.len() < degree + 4 {
            break;
        }
        out.iter().for_each(|i| used[*i] = false);
    }
    let varies = |axis: usize| rows.iter().any(|r| r.1[axis] != rows[0].1[axis]);
    let axes = (0..2).filter(|a| varies(*a)).count() as f64;
    Ok(PolynomialSmooth { residual, is_inlier: used, axes, basis: fitted, coefficients, span })
}

/// Rows of a flight that are outliers relative to their neighbours; the polynomial of [`fit_polynomials`]
/// bends to outliers at its ends. `residual`: residuals of a model (two per point, NaN if not used). A
/// parabola fits these well over a few observations even if the model is wrong; a straight line does not if
/// accelerations are large and the frame rate is low.
pub fn local_outliers(times: &[f64], residual: &[f64], sd: f64) -> Vec<usize> {
    let n = times.len();
    let mut used: Vec<bool> = (0..n).map(|i| residual[2 * i].is_finite()).collect();
    // Deviation of a row from the parabola through its neighbours, in units of its error.
    let size = |i: usize, used: &[bool]| {
        let near = nearest_rows(times, used, i);
        let weights = parabola_weights(times[i], &near.iter().map(|j| times[*j]).collect::<Vec<_>>());
        let error = (1.0 + weights.norm_squared()).sqrt();
        let off = |axis: usize| {
            let of = |j: usize| residual[2 * j + axis];
            let met: f64 = near.iter().zip(weights.iter()).map(|(j, w)| w * of(*j)).sum();
            (of(i) - met).abs() / (sd * error)
        };
        off(0).max(off(1))
    };
    let mut count = used.iter().filter(|k| **k).count();
    if count <= 2 * NEIGHBOURS {
        return Vec::new();
    }
    let mut sizes: Vec<f64> = (0..n).map(|i| if used[i] { size(i, &used) } else { 0.0 }).collect();
    let mut out = Vec::new();
    while count > 2 * NEIGHBOURS {
        let worst = (0..n).filter(|i| used[*i]).max_by(|a, b| sizes[*a].total_cmp(&sizes[*b]));
        let Some(i) = worst.filter(|i| sizes[*i] > OUTLIER_SCALES) else { break };
        used[i] = false;
        count -= 1;
        out.push(i);
        // Only the nearest rows on each side had it among their neighbours.
        let before = (0..i).rev().filter(|j| used[*j]).take(NEIGHBOURS);
        let after = (i + 1..n).filter(|j| used[*j]).take(NEIGHBOURS);
        for j in before.chain(after).collect::<Vec<_>>() {
            sizes[j] = size(j, &used);
        }
    }
    out
}

/// The [`NEIGHBOURS`] used rows nearest in time to row `i`, nearest first; `times` ascend.
fn nearest_rows(times: &[f64], used: &[bool], i: usize) -> Vec<usize> {
    let mut before = (0..i).rev().filter(|j| used[*j]).peekable();
    let mut after = (i + 1..times.len()).filter(|j| used[*j]).peekable();
    let nearest = || match (before.peek(), after.peek()) {
        (Some(b), Some(a)) if (times[*a] - times[i]).abs() < (times[*b] - times[i]).abs() => after.next(),
        (Some(_), _) => before.next(),
        (None, _) => after.next(),
    };
    std::iter::from_fn(nearest).take(NEIGHBOURS).collect()
}

/// Weights of a local parabola fit: the fitted value at `time` is the weighted sum of the values.
fn parabola_weights(time: f64, times: &[f64]) -> DVector<f64> {
    let span = times.iter().map(|t| (t - time).abs()).fold(1e-12, f64::max);
    let powers = DMatrix::from_fn(times.len(), 3, |i, k| ((times[i] - time) / span).powi(k as i32));
    (&powers * pseudo_inverse(&powers.tr_mul(&powers))).column(0).into_owned()
}

/// Orthonormal basis of the smoothing polynomials over the points with weight, which are the means of `observations`;
/// `None` if there are too few.
pub fn polynomial_basis(times: &[f64], weights: &[f64], observations: usize) -> Option<DMatrix<f64>> {
    let n = times.len();
    let degree = degree(observations);
    if weights.iter().filter(|w| **w > 0.0).count() < degree + 3 {
        return None;
    }
    let span = [times[0], times[n - 1]];
    orthonormal_basis(&DMatrix::from_fn(n, degree + 1, |i, k| weights[i] * chebyshev(k, span, times[i])))
}

fn degree(n: usize) -> usize {
    (n / 4).clamp(3, 12).min(n.saturating_sub(3))
}

/// Orthonormal columns that span those of `basis`.
pub fn orthonormal_basis(basis: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    if basis.nrows() < basis.ncols() {
        return None;
    }
    let qr = basis.clone().qr();
    Some(qr.q())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals, two per point: a bend from a wrong law and a small deterministic jitter.
    fn residual(n: usize, bend: f64) -> (Vec<f64>, Vec<f64>) {
        let times: Vec<f64> = (0..n).map(|i| 0.025 * i as f64).collect();
        let both = |i: usize| {
            let jitter = f64::from((i as u32 * 7919) % 13) / 6.0 - 1.0;
            let u = i as f64 / (n - 1) as f64 - 0.5;
            [bend * (u * u - 1.0 / 12.0) + jitter, jitter]
        };
        (times, (0..n).flat_map(both).collect())
    }

    #[test]
    fn outliers_at_ends_are_detected_and_bends_are_not() {
        let (times, mut r) = residual(40, 20.0);
        assert!(local_outliers(&times, &r, 1.0).is_empty());
        assert!(local_outliers(&times, &residual(40, 2000.0).1, 1.0).is_empty(), "however large");
        r[78] += 12.0;
        assert_eq!(local_outliers(&times, &r, 1.0), [39]);
    }

    /// The polynomial basis captures most of a bend and only its share of noise.
    #[test]
    fn polynomial_basis_captures_bends() {
        let slow = |bend: f64| {
            let (times, r) = residual(40, bend);
            let basis = polynomial_basis(&times, &[1.0; 40], 40).unwrap();
            let along =
                |axis: usize| basis.tr_mul(&DVector::from_fn(40, |i, _| r[2 * i + axis])).norm_squared();
            (along(0) + along(1), basis.ncols(), r.iter().map(|v| v * v).sum::<f64>())
        };
        let (square, count, all) = slow(0.0);
        assert_eq!(count, 11);
        assert!(square < 0.6 * all, "{square} of {all}");
        let (bent, _, all) = slow(20.0);
        assert!(bent > 0.7 * all, "{bent} of {all}");
    }
}
