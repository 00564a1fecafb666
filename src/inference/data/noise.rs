//! Noise of the observations.
//!
//! Residuals of the polynomial fits of flights ([`smoothing`](super::smoothing)) are noise, white or
//! first-order autoregressive. Its variance and correlation are estimated from all flights together by the
//! method of moments, with the expected products of residuals under the projection.
//!
//! Differences from the usual estimate (residual variance over degrees of freedom): polynomials absorb much
//! of the low-frequency power of correlated noise; the expectation under the projection corrects for that.

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
pub use crate::inference::data::smoothing::polynomial_basis;
use crate::inference::data::smoothing::{PolynomialSmooth, orthonormal_basis};
use crate::inference::kernels;
use crate::inference::statistics::median;
use crate::progress::Progress;

/// Inflation of the standard error of the correlation: polynomials absorb most of its information.
const RHO_ERROR: f64 = 2.6;

/// Range of the correlation of neighbouring observations; stronger correlation is unmodelled motion.
const RHO_RANGE: [f64; 2] = [-0.6, 0.8];

/// Noise of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// Standard deviation of one coordinate, m.
    pub sd: f64,
    /// Correlation of neighbouring observations.
    pub rho: f64,
    /// Number of residual degrees of freedom it was estimated from.
    pub degrees_of_freedom: f64,
}

impl Noise {
    /// Relative standard error of the low-frequency noise variance, from the errors of the variance and of
    /// the correlation.
    pub fn relative_variance_error(&self) -> f64 {
        let rho = self.rho;
        let own = 2.0 / self.degrees_of_freedom * (1.0 + rho * rho) / (1.0 - rho * rho);
        let by_rho = if rho > 0.0 { 2.0 * RHO_ERROR / (1.0 - rho * rho) } else { 0.0 };
        (own + by_rho * by_rho * (1.0 - rho * rho) / self.degrees_of_freedom).sqrt()
    }

    /// Variance of smooth signals under the noise relative to the noise variance: (1 + rho) / (1 - rho).
    pub fn smooth_variance_factor(&self) -> f64 {
        let rho = self.rho.max(0.0);
        (1.0 + rho) / (1.0 - rho)
    }
}

/// Variance and correlation of the noise of flights; `None` with fewer than 6 degrees of freedom.
pub fn estimate_noise(flights: &[&PolynomialSmooth], progress: &dyn Progress) -> Result<Option<Noise>> {
    let (mut squares, mut products, mut freedom) = (0.0, 0.0, 0.0);
    for s in flights {
        freedom += s.axes * (s.is_inlier.iter().filter(|k| **k).count() as f64 - s.basis.norm_squared());
        for r in &s.residual {
            squares += r.iter().map(|v| v * v).sum::<f64>();
            products += r.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
        }
    }
    if freedom < 6.0 {
        return Ok(None);
    }
    // Expected sums of squares and lag-one products under unit-variance AR(1) noise of correlation rho, after
    // the projection.
    let flights: Vec<ResidualProjector> = flights.iter().map(|s| ResidualProjector::of(s)).collect();
    let expected = |rho: f64| -> Result<(f64, f64)> {
        let mut sums = (0.0, 0.0);
        for flight in &flights {
            progress.check_stop()?;
            let (e0, e1) = flight.expected(rho);
            sums = (sums.0 + e0, sums.1 + e1);
        }
        Ok(sums)
    };
    let wanted = if squares > 0.0 { products / squares } else { 0.0 };
    let (mut low, mut high) = RHO_RANGE.into();
    for _ in 0..18 {
        let middle = 0.5 * (low + high);
        let (e0, e1) = expected(middle)?;
        if e1 / e0 < wanted { low = middle } else { high = middle }
    }
    let rho = 0.5 * (low + high);
    // A correlation that is not significant is set to zero.
    let rho = if rho.abs() < 2.5 / freedom.sqrt() { 0.0 } else { rho };
    let (e0, _) = expected(rho)?;
    Ok(Some(Noise { sd: (squares / e0).sqrt().max(1e-9), rho, degrees_of_freedom: freedom }))
}

/// Residual projector of a flight's polynomials: P = diag(inliers) - q q' with the orthonormal basis q.
struct ResidualProjector<'a> {
    smooth: &'a PolynomialSmooth,
    /// 1 for inliers, otherwise 0.
    inliers: DVector<f64>,
    /// Lag-one products of the basis: sum over i of the outer product of q's rows i + 1 and i.
    lag_one: DMatrix<f64>,
}

impl ResidualProjector<'_> {
    fn of(smooth: &PolynomialSmooth) -> ResidualProjector<'_> {
        let n = smooth.is_inlier.len();
        let q = &smooth.basis;
        ResidualProjector {
            smooth,
            inliers: DVector::from_fn(n, |i, _| f64::from(smooth.is_inlier[i])),
            lag_one: q.rows(1, n - 1).tr_mul(&q.rows(0, n - 1)),
        }
    }

    /// Expected sums of squares and of lag-one products of the residuals under AR(1) noise of unit variance: the
    /// trace of P C P and the sum along its first off-diagonal.
    fn expected(&self, rho: f64) -> (f64, f64) {
        let (q, used) = (&self.smooth.basis, &self.inliers);
        let along = kernels::autoregressive(rho, &vec![1.0; q.nrows()], q);
        let within = q.tr_mul(&along);
        let mut first = within.component_mul(&self.lag_one).sum();
        first += rho * (1..used.len()).map(|i| used[i - 1] * used[i]).sum::<f64>();
        for (q, along) in q.column_iter().zip(along.column_iter()) {
            let crossed = |i: usize| used[i - 1] * along[i - 1] * q[i] + used[i] * along[i] * q[i - 1];
            first -= (1..used.len()).map(crossed).sum::<f64>();
        }
        (self.smooth.axes * (used.sum() - within.trace()), self.smooth.axes * first)
    }
}

/// Noise standard deviation of evenly spaced series from third differences, which vanish for smooth motion
/// and rest; `None` if all have fewer than four values.
pub fn third_difference_noise(series: &[Vec<f64>]) -> Option<f64> {
    let third = |k: &[f64]| (k[3] - 3.0 * k[2] + 3.0 * k[1] - k[0]).abs();
    let thirds: Vec<f64> = series.iter().flat_map(|s| s.windows(4).map(third)).collect();
    (!thirds.is_empty()).then(|| 1.4826 * median(&thirds) / 20f64.sqrt())
}

/// Mean and variance of the residual sum of squares (unit variance) of AR(1) noise after fitting position and
/// velocity of a flight.
pub fn expected_rss_moments(times: &[f64], weights: &[f64], axes: f64, rho: f64) -> (f64, f64) {
    let n = times.len();
    let basis = DMatrix::from_fn(n, 2, |i, k| weights[i] * if k == 0 { 1.0 } else { times[i] });
    let used = DVector::from_column_slice(weights);
    // With q orthonormal over the used rows the residual projector is P = diag(used) - q q'; mean and variance follow
    // from the traces of C P and of its square.
    let (mut mean, mut square) = (used.sum(), kernels::squared_sum(rho, &used));
    if let Some(q) = orthonormal_basis(&basis) {
        let along = kernels::autoregressive(rho, &vec![1.0; n], &q);
        let within = q.tr_mul(&along);
        let counted = |i: usize| used[i] * along.row(i).norm_squared();
        mean -= within.trace();
        square += within.norm_squared() - 2.0 * (0..n).map(counted).sum::<f64>();
    }
    (axes * mean, 2.0 * axes * square)
}

/// Correlation matrix of first-order autoregressive noise at some rows of a record.
pub fn ar1_correlation(rows: &[usize], rho: f64) -> DMatrix<f64> {
    let n = rows.len();
    DMatrix::from_fn(n, n, |i, j| rho.powi(rows[i].abs_diff(rows[j]) as i32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::data::smoothing::{TimedPosition, fit_polynomials};
    use crate::progress::NoProgress;
    use crate::rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Recovers a noise of 2 mm and its correlation from flights.
    #[test]
    fn noise_and_correlation_are_estimated() {
        let mut stream = rng::stream(3, "test");
        for rho in [0.0, 0.5] {
            let flights: Vec<PolynomialSmooth> = (0..40)
                .map(|_| {
                    let mut off = [0.0; 2];
                    let mut row = |i: usize| {
                        let t = 0.02 * i as f64;
                        off.iter_mut().for_each(|o| {
                            let draw: f64 = StandardNormal.sample(&mut stream);
                            *o = if i == 0 {
                                2e-3 * draw
                            } else {
                                rho * *o + 2e-3 * (1.0 - rho * rho).sqrt() * draw
                            };
                        });
                        (t, [3.0 * t + off[0], 2.0 + 4.0 * t - 4.905 * t * t + off[1]])
                    };
                    fit_polynomials(&(0..40).map(&mut row).collect::<Vec<TimedPosition>>(), &NoProgress)
                        .unwrap()
                })
                .collect();
            let found = estimate_noise(&flights.iter().collect::<Vec<_>>(), &NoProgress).unwrap().unwrap();
            assert!(
                (found.sd / 2e-3 - 1.0).abs() < 0.1 && (found.rho - rho).abs() < 0.1,
                "{found:?} for {rho}"
            );
        }
    }

    /// With white noise, position and velocity take two degrees of freedom per axis; points of weight 0 do
    /// not count.
    #[test]
    fn initial_states_take_two_degrees_per_axis() {
        let times: Vec<f64> = (0..20).map(|i| 0.1 * f64::from(i)).collect();
        let mut weights = [1.0; 20];
        let (mean, variance) = expected_rss_moments(&times, &weights, 2.0, 0.0);
        assert!((mean - 36.0).abs() < 1e-9 && (variance - 72.0).abs() < 1e-9);
        weights[7] = 0.0;
        assert!((expected_rss_moments(&times, &weights, 1.0, 0.0).0 - 17.0).abs() < 1e-9);
    }

    #[test]
    fn third_differences_ignore_smooth_motion() {
        let mut stream = rng::stream(4, "test");
        let mut series = |sd: f64| -> Vec<f64> {
            let at = |i: u32| 4.0 * f64::from(i) - 0.3 * f64::from(i * i);
            let mut draw = || -> f64 { StandardNormal.sample(&mut stream) };
            (0..2000).map(|i| at(i) + sd * draw()).collect()
        };
        assert!(third_difference_noise(&[series(0.0)]).unwrap() < 1e-8);
        assert!((third_difference_noise(&[series(0.02)]).unwrap() / 0.02 - 1.0).abs() < 0.1);
        assert_eq!(third_difference_noise(&[vec![1.0; 3], Vec::new()]), None);
    }
}
