//! Gaussian-process regression with derivatives, for functions of a few variables known at some dozens of points.
//!
//! y_j = m + f(x_j) + noise, f ~ GP(0, s^2 c), with the Matern 5/2 correlation
//!   c(r) = (1 + sqrt5 r + 5 r^2 / 3) exp(-sqrt5 r),  r^2 = sum_i ((x_i - x'_i) / l_i)^2,
//! which is twice differentiable, as rough as a performance surface may be and no smoother. The constant m and the
//! scale s^2 are profiled out; length scales l_i and the noise-to-signal ratio v maximise the marginal likelihood
//! times weak log-normal priors (l near half the range; without them few noisy points are fitted by a spike each).
//!
//! Source: Rasmussen and Williams 2006, chapters 2, 4.2 and 5.4. Differences from the source: m's own uncertainty is
//! left out of the variances (it is small with dozens of points); the search over (l, v) is a compass search from a
//! few fixed starts, so the same data give the same bits.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// What is fitted besides the data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hyper {
    /// (dimension,) how far one must go for the function to change, in units of the inputs.
    pub length_scales: Vec<f64>,
    /// Constant that the function varies around.
    pub mean: f64,
    /// Standard deviation of the function around it.
    pub signal: f64,
    /// Standard deviation of the noise on a value.
    pub noise: f64,
}

/// A number with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Belief {
    pub mean: f64,
    pub sd: f64,
}

/// Data and hyperparameters, ready to predict.
pub struct Gp {
    points: Vec<Vec<f64>>,
    hyper: Hyper,
    /// Of the covariance of the values.
    factor: Cholesky<f64, Dyn>,
    /// Covariance^-1 (y - m).
    weights: DVector<f64>,
}

impl Hyper {
    /// The hyperparameters that explain the data best. Inputs are best of about unit range.
    pub fn fit(points: &[Vec<f64>], values: &[f64]) -> Result<Hyper> {
        let dimension = points.first().map_or(0, Vec::len);
        if dimension == 0 || points.len() < 3 || points.len() != values.len() {
            return Err(Error::input("points", points.len(), "at least 3, of one variable or more each"));
        }
        let spread = spread(values);
        if spread < 1e-12 {
            // Nothing varies: any scales do.
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            return Ok(Hyper { length_scales: vec![1.0; dimension], mean, signal: 1e-9, noise: 1e-9 });
        }
        let lost = |x: &[f64]| profiled(points, values, x).map_or(f64::INFINITY, |(loss, _)| loss);
        let starts = [(0.5, 0.01), (0.25, 0.1), (1.0, 0.1), (1.0, 1.0)];
        let best = starts
            .iter()
            .map(|(length, ratio)| {
                let mut start = vec![libm::log(*length); dimension];
                start.push(libm::log(*ratio));
                compass(&lost, start)
            })
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let best = best.map(|(x, _)| x).unwrap_or_default();
        let (_, hyper) = profiled(points, values, &best)
            .ok_or_else(|| Error::Failed("no length scales explain the surface's points".into()))?;
        Ok(hyper)
    }
}

impl Gp {
    /// The process given the values at the points.
    pub fn new(points: Vec<Vec<f64>>, values: &[f64], hyper: Hyper) -> Result<Gp> {
        let n = points.len();
        let same = points.iter().all(|p| p.len() == hyper.length_scales.len());
        if n == 0 || n != values.len() || !same {
            return Err(Error::input(
                "points",
                n,
                "as many as values, each with one number per length scale",
            ));
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
        Ok(Gp { points, hyper, factor, weights })
    }

    /// The function at `x`, noise left out.
    pub fn at(&self, x: &[f64]) -> Belief {
        let s2 = self.hyper.signal.powi(2);
        let k = self.column(|p| s2 * correlation(x, p, &self.hyper.length_scales));
        let variance = s2 - k.dot(&self.factor.solve(&k));
        Belief { mean: self.hyper.mean + k.dot(&self.weights), sd: variance.max(0.0).sqrt() }
    }

    /// Its partial derivatives at `x`, one for each variable.
    pub fn gradient(&self, x: &[f64]) -> Vec<Belief> {
        let s2 = self.hyper.signal.powi(2);
        let scales = &self.hyper.length_scales;
        (0..x.len())
            .map(|i| {
                let l2 = scales[i].powi(2);
                // d c / d x_i = -(5/3) (1 + sqrt5 r) exp(-sqrt5 r) (x_i - p_i) / l_i^2; its variance at a point
                // before any data is (5/3) s^2 / l_i^2.
                let k = self.column(|p| {
                    let r = 5f64.sqrt() * distance(x, p, scales);
                    -5.0 / 3.0 * s2 * (1.0 + r) * libm::exp(-r) * (x[i] - p[i]) / l2
                });
                let variance = 5.0 / 3.0 * s2 / l2 - k.dot(&self.factor.solve(&k));
                Belief { mean: k.dot(&self.weights), sd: variance.max(0.0).sqrt() }
            })
            .collect()
    }

    fn column(&self, of: impl Fn(&[f64]) -> f64) -> DVector<f64> {
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

/// What the search minimises (the negative log posterior, up to constants) at the logarithms of length scales and
/// noise ratio, and the hyperparameters there with mean and signal profiled out.
fn profiled(points: &[Vec<f64>], values: &[f64], x: &[f64]) -> Option<(f64, Hyper)> {
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
    let off = y.map(|v| v - mean);
    let s2 = off.dot(&factor.solve(&off)) / n as f64;
    if !(s2 > 0.0 && s2.is_finite()) {
        return None;
    }
    let log_det = 2.0 * (0..n).map(|i| libm::log(factor.l_dirty()[(i, i)])).sum::<f64>();
    let prior = |v: f64, centre: f64, width: f64| 0.5 * ((v - libm::log(centre)) / width).powi(2);
    let priors =
        x[..x.len() - 1].iter().map(|l| prior(*l, 0.5, 1.0)).sum::<f64>() + prior(x[x.len() - 1], 0.03, 3.0);
    let loss = 0.5 * (n as f64 * libm::log(s2) + log_det) + priors;
    let signal = s2.sqrt();
    Some((loss, Hyper { length_scales: scales, mean, signal, noise: (s2 * ratio).sqrt() }))
}

/// Compass search: one coordinate at a time, the step halved when none helps.
fn compass(lost: &impl Fn(&[f64]) -> f64, mut x: Vec<f64>) -> (Vec<f64>, f64) {
    let mut best = lost(&x);
    let mut step = 1.0;
    while step > 0.01 {
        let mut moved = false;
        for i in 0..x.len() {
            for to in [-step, step] {
                let mut next = x.clone();
                next[i] += to;
                let loss = lost(&next);
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

fn spread(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng;
    use rand::RngExt;
    use rand_distr::{Distribution, StandardNormal};

    fn truth(x: &[f64]) -> f64 {
        libm::sin(3.0 * x[0]) + 0.2 * x[1]
    }

    fn fitted(n: usize, noise: f64) -> Gp {
        let mut stream = rng::stream(3, "gp");
        let points: Vec<Vec<f64>> = (0..n).map(|_| vec![stream.random(), stream.random()]).collect();
        let values: Vec<f64> = points
            .iter()
            .map(|p| {
                let e: f64 = StandardNormal.sample(&mut stream);
                truth(p) + noise * e
            })
            .collect();
        let hyper = Hyper::fit(&points, &values).unwrap();
        Gp::new(points, &values, hyper).unwrap()
    }

    #[test]
    fn values_and_slopes_of_a_known_function_are_found() {
        let gp = fitted(40, 0.0);
        for x in [[0.3, 0.4], [0.5, 0.7], [0.7, 0.2]] {
            assert!((gp.at(&x).mean - truth(&x)).abs() < 0.01, "{:?}", gp.at(&x));
            let [first, second] = [gp.gradient(&x)[0], gp.gradient(&x)[1]];
            assert!((first.mean - 3.0 * libm::cos(3.0 * x[0])).abs() < 0.15, "{first:?} at {x:?}");
            assert!((second.mean - 0.2).abs() < 0.1, "{second:?} at {x:?}");
        }
        // The function changes faster along the first variable, and the length scales say so.
        assert!(gp.hyper.length_scales[0] < gp.hyper.length_scales[1], "{:?}", gp.hyper);
    }

    /// The analytic slope is the slope of the mean, and its deviation that of differences of draws.
    #[test]
    fn slopes_are_those_of_the_prediction() {
        let gp = fitted(25, 0.1);
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
                let k = |x: &[f64]| gp.column(|p| s2 * correlation(x, p, scales));
                let cov =
                    |x: &[f64], y: &[f64]| s2 * correlation(x, y, scales) - k(x).dot(&gp.factor.solve(&k(y)));
                let variance = (cov(&a, &a) + cov(&b, &b) - 2.0 * cov(&a, &b)) / (4.0 * h * h);
                let (found, wanted) = (gp.gradient(&x)[i].sd, variance.sqrt());
                assert!((found / wanted - 1.0).abs() < 0.02, "{found} against {wanted}");
            }
        }
    }

    /// Its deviations are honest: about two thirds of the truth within one, nearly all within three; the noise is
    /// told from the function.
    #[test]
    fn deviations_are_honest() {
        let gp = fitted(60, 0.2);
        assert!((0.12..0.3).contains(&gp.hyper.noise), "{:?}", gp.hyper);
        let mut stream = rng::stream(9, "gp");
        let off: Vec<f64> = (0..300)
            .map(|_| {
                let x = [stream.random::<f64>(), stream.random::<f64>()];
                let found = gp.at(&x);
                (found.mean - truth(&x)).abs() / found.sd
            })
            .collect();
        let within = |k: f64| off.iter().filter(|o| **o < k).count() as f64 / off.len() as f64;
        assert!(within(1.0) > 0.4 && within(3.0) > 0.95, "{} {}", within(1.0), within(3.0));
    }

    #[test]
    fn data_that_cannot_be_fitted_are_refused_or_flat() {
        assert!(Hyper::fit(&[vec![0.0], vec![1.0]], &[1.0, 2.0]).is_err());
        let points: Vec<Vec<f64>> = (0..5).map(|i| vec![f64::from(i) / 4.0]).collect();
        let hyper = Hyper::fit(&points, &[0.3; 5]).unwrap();
        let gp = Gp::new(points.clone(), &[0.3; 5], hyper.clone()).unwrap();
        assert!((gp.at(&[0.5]).mean - 0.3).abs() < 1e-12 && gp.gradient(&[0.5])[0].mean.abs() < 1e-9);
        assert!(Gp::new(points, &[0.3; 4], hyper).is_err());
    }
}
