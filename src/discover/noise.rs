//! The noise floor: what no smooth motion explains.
//!
//! What [`smooth`](super::smooth) leaves of flights is noise, white or first-order autoregressive; its variance and correlation
//! are estimated from all flights together, each corrected for what the polynomial swallowed (the expected value of the
//! residuals' products under projection).
//!
//! Differences from the usual estimate (residual variance over degrees of freedom): correlated noise has much of its
//! power at low frequencies, where the polynomial swallows it; without the correction every correlated recording would
//! look like misfit.

use nalgebra::{DMatrix, DVector};

use super::kernels;
pub use super::smooth::slow_basis;
use super::smooth::{Smooth, orthonormal};
use super::stats::median;
use crate::error::Result;
use crate::progress::Progress;

/// How much less well the correlation is known than from as many free neighbours: polynomials swallow what tells most.
const RHO_ERROR: f64 = 2.6;

/// Least and greatest correlation of neighbouring observations: what hangs together more is motion that no polynomial follows.
/// (With 0.95, two millimetres of noise were told as a hundred where bumps pushed a ball about.)
const CORRELATED: [f64; 2] = [-0.6, 0.8];

/// Noise of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// Standard deviation of one coordinate, m.
    pub sd: f64,
    /// Correlation of neighbouring observations.
    pub rho: f64,
    /// Number of residual degrees of freedom it was estimated from.
    pub freedom: f64,
}

impl Noise {
    /// Relative error of the variance of slow things: of the noise's own variance, and of its correlation where it has any,
    /// which fast residuals tell and slow ones depend on.
    pub fn floor_error(&self) -> f64 {
        let rho = self.rho;
        let own = 2.0 / self.freedom * (1.0 + rho * rho) / (1.0 - rho * rho);
        let by_rho = if rho > 0.0 { 2.0 * RHO_ERROR / (1.0 - rho * rho) } else { 0.0 };
        (own + by_rho * by_rho * (1.0 - rho * rho) / self.freedom).sqrt()
    }

    /// Variance of smooth things under the noise, in its own variance: correlated noise counts for less.
    pub fn unit(&self) -> f64 {
        let rho = self.rho.max(0.0);
        (1.0 + rho) / (1.0 - rho)
    }
}

/// Variance and correlation of the noise of some flights; `None` without enough to estimate them from.
pub fn noise(flights: &[&Smooth], progress: &dyn Progress) -> Result<Option<Noise>> {
    let (mut squares, mut products, mut freedom) = (0.0, 0.0, 0.0);
    for s in flights {
        freedom += s.axes * (s.kept.iter().filter(|k| **k).count() as f64 - s.basis.norm_squared());
        for r in &s.residual {
            squares += r.iter().map(|v| v * v).sum::<f64>();
            products += r.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
        }
    }
    if freedom < 6.0 {
        return Ok(None);
    }
    // Expected sums under unit-variance AR(1) noise of correlation rho, after the projection.
    let flights: Vec<Projection> = flights.iter().map(|s| Projection::of(s)).collect();
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
    let (mut low, mut high) = CORRELATED.into();
    for _ in 0..18 {
        let middle = 0.5 * (low + high);
        let (e0, e1) = expected(middle)?;
        if e1 / e0 < wanted { low = middle } else { high = middle }
    }
    let rho = 0.5 * (low + high);
    // Within its own error of nothing it is nothing.
    let rho = if rho.abs() < 2.5 / freedom.sqrt() { 0.0 } else { rho };
    let (e0, _) = expected(rho)?;
    Ok(Some(Noise { sd: (squares / e0).sqrt().max(1e-9), rho, freedom }))
}

/// The residual projector of a flight's polynomials, P = diag(kept) - q q'.
struct Projection<'a> {
    smooth: &'a Smooth,
    kept: DVector<f64>,
    /// Sum over neighbouring rows of the products of theirs in q.
    neighbours: DMatrix<f64>,
}

impl Projection<'_> {
    fn of(smooth: &Smooth) -> Projection<'_> {
        let n = smooth.kept.len();
        let q = &smooth.basis;
        Projection {
            smooth,
            kept: DVector::from_fn(n, |i, _| f64::from(smooth.kept[i])),
            neighbours: q.rows(1, n - 1).tr_mul(&q.rows(0, n - 1)),
        }
    }

    /// Expected sums of squares and of products of neighbouring residuals under AR(1) noise of unit variance: the trace of
    /// P C P and the sum along its first off-diagonal.
    fn expected(&self, rho: f64) -> (f64, f64) {
        let (q, kept) = (&self.smooth.basis, &self.kept);
        let along = kernels::autoregressive(rho, &vec![1.0; q.nrows()], q);
        let within = q.tr_mul(&along);
        let mut first = within.component_mul(&self.neighbours).sum();
        first += rho * (1..kept.len()).map(|i| kept[i - 1] * kept[i]).sum::<f64>();
        for (q, along) in q.column_iter().zip(along.column_iter()) {
            let crossed = |i: usize| kept[i - 1] * along[i - 1] * q[i] + kept[i] * along[i] * q[i - 1];
            first -= (1..kept.len()).map(crossed).sum::<f64>();
        }
        (self.smooth.axes * (kept.sum() - within.trace()), self.smooth.axes * first)
    }
}

/// Noise of series of evenly seen values from their third differences, which smooth motion and rest leave at nothing; `None`
/// of fewer than four values each.
pub fn by_thirds(series: &[Vec<f64>]) -> Option<f64> {
    let third = |k: &[f64]| (k[3] - 3.0 * k[2] + 3.0 * k[1] - k[0]).abs();
    let thirds: Vec<f64> = series.iter().flat_map(|s| s.windows(4).map(third)).collect();
    (!thirds.is_empty()).then(|| 1.4826 * median(&thirds) / 20f64.sqrt())
}

/// Mean and variance of the residual sum of squares (unit variance) that AR(1) noise leaves in both coordinates of a
/// flight of which a straight start (position and velocity) is fitted freely.
pub fn expected_squares(times: &[f64], weights: &[f64], axes: f64, rho: f64) -> (f64, f64) {
    let n = times.len();
    let basis = DMatrix::from_fn(n, 2, |i, k| weights[i] * if k == 0 { 1.0 } else { times[i] });
    let kept = DVector::from_column_slice(weights);
    // With q orthonormal over the rows that count the residual projector is P = diag(kept) - q q'; this is the trace of
    // C P, and that of its square.
    let (mut mean, mut square) = (kept.sum(), kernels::squared_sum(rho, &kept));
    if let Some(q) = orthonormal(&basis) {
        let along = kernels::autoregressive(rho, &vec![1.0; n], &q);
        let within = q.tr_mul(&along);
        let counted = |i: usize| kept[i] * along.row(i).norm_squared();
        mean -= within.trace();
        square += within.norm_squared() - 2.0 * (0..n).map(counted).sum::<f64>();
    }
    (axes * mean, 2.0 * axes * square)
}

/// Correlation of first-order autoregressive noise at some rows of a record.
pub fn correlation(rows: &[usize], rho: f64) -> DMatrix<f64> {
    let n = rows.len();
    DMatrix::from_fn(n, n, |i, j| rho.powi(rows[i].abs_diff(rows[j]) as i32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::smooth::{Row, smooth};
    use crate::progress::NoProgress;
    use crate::rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Noise of 2 mm, each row 0.5 of the one before, is told of flights whose motion is none of it.
    #[test]
    fn noise_and_its_correlation_are_told_beside_motion() {
        let mut stream = rng::stream(3, "test");
        for rho in [0.0, 0.5] {
            let flights: Vec<Smooth> = (0..40)
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
                    smooth(&(0..40).map(&mut row).collect::<Vec<Row>>())
                })
                .collect();
            let found = noise(&flights.iter().collect::<Vec<_>>(), &NoProgress).unwrap().unwrap();
            assert!(
                (found.sd / 2e-3 - 1.0).abs() < 0.1 && (found.rho - rho).abs() < 0.1,
                "{found:?} for {rho}"
            );
        }
    }

    /// White noise beside a straight start: two of n numbers an axis are taken up. What does not count is none.
    #[test]
    fn a_straight_start_takes_two_numbers_an_axis() {
        let times: Vec<f64> = (0..20).map(|i| 0.1 * f64::from(i)).collect();
        let mut weights = [1.0; 20];
        let (mean, variance) = expected_squares(&times, &weights, 2.0, 0.0);
        assert!((mean - 36.0).abs() < 1e-9 && (variance - 72.0).abs() < 1e-9);
        weights[7] = 0.0;
        assert!((expected_squares(&times, &weights, 1.0, 0.0).0 - 17.0).abs() < 1e-9);
    }

    #[test]
    fn third_differences_leave_smooth_motion_at_nothing() {
        let mut stream = rng::stream(4, "test");
        let mut series = |sd: f64| -> Vec<f64> {
            let at = |i: u32| 4.0 * f64::from(i) - 0.3 * f64::from(i * i);
            let mut draw = || -> f64 { StandardNormal.sample(&mut stream) };
            (0..2000).map(|i| at(i) + sd * draw()).collect()
        };
        assert!(by_thirds(&[series(0.0)]).unwrap() < 1e-8);
        assert!((by_thirds(&[series(0.02)]).unwrap() / 0.02 - 1.0).abs() < 0.1);
        assert_eq!(by_thirds(&[vec![1.0; 3], Vec::new()]), None);
    }
}
