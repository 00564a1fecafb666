//! Gaussian-process regression with derivatives, for functions of a few variables known at some dozens of
//! points.
//!
//! y_j = m + f(x_j) + noise, f ~ GP(0, s^2 c), with the Matern 5/2 correlation
//!   c(r) = (1 + sqrt5 r + 5 r^2 / 3) exp(-sqrt5 r),  r^2 = sum_i ((x_i - x'_i) / l_i)^2,
//! which is twice differentiable. The constant mean m and the signal variance s^2 are profiled out. Length
//! scales l_i and the noise-to-signal variance ratio v maximise the marginal likelihood times weak log-normal
//! priors (l near half the range; without them few noisy points would be interpolated by one spike each).
//!
//! Source: Rasmussen and Williams 2006, chapters 2, 4.2 and 5.4.
//!
//! Differences from the source: the uncertainty of m is not part of the predictive variance (it is small with
//! dozens of points). The search over (l, v) is a compass search from fixed starting points, so the same data
//! give the same bits.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Hyperparameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GpHyperparameters {
    /// (dimension,) correlation lengths in units of the inputs.
    pub length_scales: Vec<f64>,
    /// Constant mean.
    pub mean: f64,
    /// Signal standard deviation.
    pub signal: f64,
    /// Noise standard deviation.
    pub noise: f64,
}

/// Predictive mean and standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GpPrediction {
    pub mean: f64,
    pub sd: f64,
}

/// A Gaussian process conditioned on data.
pub struct GaussianProcess {
    points: Vec<Vec<f64>>,
    hyper: GpHyperparameters,
    /// Cholesky factor of the covariance of the values.
    factor: Cholesky<f64, Dyn>,
    /// Covariance^-1 (y - m).
    weights: DVector<f64>,
}

impl GpHyperparameters {
    /// Maximum a posteriori hyperparameters. Scale inputs to about unit range.
    pub fn fit(points: &[Vec<f64>], values: &[f64]) -> Result<GpHyperparameters> {
        let dimension = points.first().map_or(0, Vec::len);
        if dimension == 0 || points.len() < 3 || points.len() != values.len() {
            return Err(Error::input("points", points.len(), "at least 3 points of at least one variable"));
        }
        let spread = standard_deviation(values);
        if spread < 1e-12 {
            // Constant values: length scales are arbitrary.
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            return Ok(GpHyperparameters {
                length_scales: vec![1.0; dimension],
                mean,
                signal: 1e-9,
                noise: 1e-9,
            });
        }
        let objective =
            |x: &[f64]| profile_posterior(points, values, x).map_or(f64::INFINITY, |(loss, _)| loss);
        let starts = [(0.5, 0.01), (0.25, 0.1), (1.0, 0.1), (1.0, 1.0)];
        let best = starts
            .iter()
            .map(|(length, ratio)| {
                let mut start = vec![libm::log(*length); dimension];
                start.push(libm::log(*ratio));
                compass_search(&objective, start)
            })
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let best = best.map(|(x, _)| x).unwrap_or_default();
        let (_, hyper) = profile_posterior(points, values, &best).ok_or_else(|| {
            Error::Failed("the Gaussian process could not be fitted to the surface's points".into())
        })?;
        Ok(hyper)
    }
}

impl GaussianProcess {
    /// Conditions the process on values at points.
    pub fn new(points: Vec<Vec<f64>>, values: &[f64], hyper: GpHyperparameters) -> Result<GaussianProcess> {
        let n = points.len();
        let same = points.iter().all(|p| p.len() == hyper.length_scales.len());
        if n == 0 || n != values.len() || !same {
            let allowed = "as many points as values, with one coordinate per length scale";
            return Err(Error::input("points", n, allowed));
        }
        let s2 = hyper.signal.powi(2);
        let jitter = 1e-10 * s2 + hyper.noise.powi(2);
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            s2 * correlation(&points[i], &points[j], &hyper.length_scales) + if i == j { jitter } else { 0.0 }
        });
        let factor = covariance.cholesky().ok_or_else(|| {
            Error::Failed("the surface's points are too close for its length scales".into())
        })?;
        let weights = factor.solve(&DVector::from_iterator(n, values.iter().map(|y| y - hyper.mean)));
        Ok(GaussianProcess { points, hyper, factor, weights })
    }

    /// Prediction of the noise-free function at `x`.
    pub fn at(&self, x: &[f64]) -> GpPrediction {
        let s2 = self.hyper.signal.powi(2);
        let k = self.covariances_with(|p| s2 * correlation(x, p, &self.hyper.length_scales));
        let variance = s2 - k.dot(&self.factor.solve(&k));
        GpPrediction { mean: self.hyper.mean + k.dot(&self.weights), sd: variance.max(0.0).sqrt() }
    }

    /// Predictions of the partial derivatives at `x`, one per variable.
    pub fn gradient(&self, x: &[f64]) -> Vec<GpPrediction> {
        let s2 = self.hyper.signal.powi(2);
        let scales = &self.hyper.length_scales;
        (0..x.len())
            .map(|i| {
                let l2 = scales[i].powi(2);
                // d c / d x_i = -(5/3) (1 + sqrt5 r) exp(-sqrt5 r) (x_i - p_i) / l_i^2; its prior variance is
                // (5/3) s^2 / l_i^2.
                let k = self.covariances_with(|p| {
                    let r = 5f64.sqrt() * distance(x, p, scales);
                    -5.0 / 3.0 * s2 * (1.0 + r) * libm::exp(-r) * (x[i] - p[i]) / l2
                });
                let variance = 5.0 / 3.0 * s2 / l2 - k.dot(&self.factor.solve(&k));
                GpPrediction { mean: k.dot(&self.weights), sd: variance.max(0.0).sqrt() }
            })
            .collect()
    }

    fn covariances_with(&self, of: impl Fn(&[f64]) -> f64) -> DVector<f64> {
        DVector::from_iterator(self.points.len(), self.points.iter().map(|p| of(p)))
    }
}

fn distance(a: &[f64], b: &[f64], scales: &[f64]) -> f64 {
    a.iter().zip(b).zip(scales).map(|((a, b), l)| ((a - b) / l).powi(2)).sum::<f64>().sqrt()
}

fn correlation(a: &[f64], b: &[f64], scales: &[f64]) -> f64 {
    let r = 5f64.sqrt() * distance(a, b, scales);
    (1.0 + r + r * r / 3.0) * libm::exp(-r)
}

/// Negative log posterior up to constants at the logarithms of length scales and noise ratio, and the
/// hyperparameters with mean and signal profiled out.
fn profile_posterior(points: &[Vec<f64>], values: &[f64], x: &[f64]) -> Option<(f64, GpHyperparameters)> {
    let n = points.len();
    let (scales, ratio) = x.split_at(x.len() - 1);
    let scales: Vec<f64> = scales.iter().map(|l| libm::exp(*l)).collect();
    let ratio = libm::exp(ratio[0]);
    if scales.iter().any(|l| !(0.05..=20.0).contains(l)) || !(1e-8..=1e3).contains(&ratio) {
        return None;
    }
    let matrix = DMatrix::from_fn(n, n, |i, j| {
        correlation(&points[i], &points[j], &scales) + if i == j { ratio + 1e-10 } else { 0.0 }
    });
    let factor = matrix.cholesky()?;
    let (ones, y) = (DVector::from_element(n, 1.0), DVector::from_column_slice(values));
    let whitened = factor.solve(&ones);
    let mean = y.dot(&whitened) / ones.dot(&whitened);
    let deviation = y.map(|v| v - mean);
    let s2 = deviation.dot(&factor.solve(&deviation)) / n as f64;
    if !(s2 > 0.0 && s2.is_finite()) {
        return None;
    }
    let log_det = 2.0 * (0..n).map(|i| libm::log(factor.l_dirty()[(i, i)])).sum::<f64>();
    let prior = |v: f64, centre: f64, width: f64| 0.5 * ((v - libm::log(centre)) / width).powi(2);
    let priors =
        x[..x.len() - 1].iter().map(|l| prior(*l, 0.5, 1.0)).sum::<f64>() + prior(x[x.len() - 1], 0.03, 3.0);
    let loss = 0.5 * (n as f64 * libm::log(s2) + log_det) + priors;
    let signal = s2.sqrt();
    Some((loss, GpHyperparameters { length_scales: scales, mean, signal, noise: (s2 * ratio).sqrt() }))
}

/// Compass search: one coordinate at a time; the step is halved when no move improves.
fn compass_search(objective: &impl Fn(&[f64]) -> f64, mut x: Vec<f64>) -> (Vec<f64>, f64) {
    let mut best = objective(&x);
    let mut step = 1.0;
    while step > 0.01 {
        let mut moved = false;
        for i in 0..x.len() {
            for to in [-step, step] {
                let mut next = x.clone();
                next[i] += to;
                let loss = objective(&next);
                if loss < best - 1e-9 {
                    (x, best, moved) = (next, loss, true);
                }
            }
        }
        if !moved {
            step /= 2.0;
        }
    }
    (x, best)
}

fn standard_deviation(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng;
    use rand::RngExt;
    use rand_distr::{Distribution, StandardNormal};

    fn true_function(x: &[f64]) -> f64 {
        libm::sin(3.0 * x[0]) + 0.2 * x[1]
    }

    fn fitted_gp(n: usize, noise: f64) -> GaussianProcess {
        let mut stream = rng::stream(3, "gp");
        let points: Vec<Vec<f64>> = (0..n).map(|_| vec![stream.random(), stream.random()]).collect();
        let values: Vec<f64> = points
            .iter()
            .map(|p| {
                let e: f64 = StandardNormal.sample(&mut stream);
                true_function(p) + noise * e
            })
            .collect();
        let hyper = GpHyperparameters::fit(&points, &values).unwrap();
        GaussianProcess::new(points, &values, hyper).unwrap()
    }

    #[test]
    fn recovers_values_and_gradients_of_a_known_function() {
        let gp = fitted_gp(40, 0.0);
        for x in [[0.3, 0.4], [0.5, 0.7], [0.7, 0.2]] {
            assert!((gp.at(&x).mean - true_function(&x)).abs() < 0.01, "{:?}", gp.at(&x));
            let [first, second] = [gp.gradient(&x)[0], gp.gradient(&x)[1]];
            assert!((first.mean - 3.0 * libm::cos(3.0 * x[0])).abs() < 0.15, "{first:?} at {x:?}");
            assert!((second.mean - 0.2).abs() < 0.1, "{second:?} at {x:?}");
        }
        // The function varies faster along the first variable, so its length scale is shorter.
        assert!(gp.hyper.length_scales[0] < gp.hyper.length_scales[1], "{:?}", gp.hyper);
    }

    /// The analytic gradient equals the numerical gradient of the mean, and its sd that of posterior
    /// differences.
    #[test]
    fn gradient_matches_numerical_derivative() {
        let gp = fitted_gp(25, 0.1);
        for x in [[0.2, 0.9], [0.55, 0.45]] {
            for i in 0..2 {
                let h = 1e-4;
                let at = |to: f64| {
                    let mut moved = x;
                    moved[i] += to;
                    moved
                };
                let numeric = (gp.at(&at(h)).mean - gp.at(&at(-h)).mean) / (2.0 * h);
                assert!((numeric - gp.gradient(&x)[i].mean).abs() < 1e-5);
                // Var[(f(x+h) - f(x-h)) / 2h] from the posterior covariance.
                let scales = &gp.hyper.length_scales;
                let s2 = gp.hyper.signal.powi(2);
                let h = 0.01;
                let (a, b) = (at(h), at(-h));
                let k = |x: &[f64]| gp.covariances_with(|p| s2 * correlation(x, p, scales));
                let cov =
                    |x: &[f64], y: &[f64]| s2 * correlation(x, y, scales) - k(x).dot(&gp.factor.solve(&k(y)));
                let variance = (cov(&a, &a) + cov(&b, &b) - 2.0 * cov(&a, &b)) / (4.0 * h * h);
                let (found, wanted) = (gp.gradient(&x)[i].sd, variance.sqrt());
                assert!((found / wanted - 1.0).abs() < 0.02, "{found} against {wanted}");
            }
        }
    }

    /// Predictive standard deviations are calibrated: about two thirds of errors within one, nearly all within
    /// three; the noise is estimated correctly.
    #[test]
    fn standard_deviations_are_calibrated() {
        let gp = fitted_gp(60, 0.2);
        assert!((0.12..0.3).contains(&gp.hyper.noise), "{:?}", gp.hyper);
        let mut stream = rng::stream(9, "gp");
        let deviation: Vec<f64> = (0..300)
            .map(|_| {
                let x = [stream.random::<f64>(), stream.random::<f64>()];
                let found = gp.at(&x);
                (found.mean - true_function(&x)).abs() / found.sd
            })
            .collect();
        let within = |k: f64| deviation.iter().filter(|o| **o < k).count() as f64 / deviation.len() as f64;
        assert!(within(1.0) > 0.4 && within(3.0) > 0.95, "{} {}", within(1.0), within(3.0));
    }

    #[test]
    fn rejects_too_few_points_and_fits_constants() {
        assert!(GpHyperparameters::fit(&[vec![0.0], vec![1.0]], &[1.0, 2.0]).is_err());
        let points: Vec<Vec<f64>> = (0..5).map(|i| vec![f64::from(i) / 4.0]).collect();
        let hyper = GpHyperparameters::fit(&points, &[0.3; 5]).unwrap();
        let gp = GaussianProcess::new(points.clone(), &[0.3; 5], hyper.clone()).unwrap();
        assert!((gp.at(&[0.5]).mean - 0.3).abs() < 1e-12 && gp.gradient(&[0.5])[0].mean.abs() < 1e-9);
        assert!(GaussianProcess::new(points, &[0.3; 4], hyper).is_err());
    }
}
