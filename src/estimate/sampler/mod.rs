//! Draws from a posterior density that is evaluated in batches.
//!
//! [`prior`]: what is believed of each number beforehand. [`smc`]: sequential Monte Carlo from a reference near the fit;
//! [`mcmc`]: Markov chains on the same density, which begin where [`start`] says. [`quality`]: how far draws can be trusted. All of it
//! is data in, data out: a [`Target`] says how likely points are, a seed decides every draw.

pub mod mcmc;
mod particles;
pub mod prior;
pub mod quality;
pub mod reference;
pub mod smc;
pub mod start;

use nalgebra::{DMatrix, DVector};
use rand::RngExt;

use crate::error::Result;
use crate::rng::Stream;
use crate::world::Sample;
pub use prior::{Marginal, Prior};
pub use quality::Quality;
pub use reference::Reference;

/// A density over points, known up to a constant.
pub trait Target: Sync {
    /// What is believed of the numbers of a point.
    fn prior(&self) -> &Prior;

    /// How many numbers, the first of each point, are worth moving alone: those of which less is told than of the many that follow.
    fn alone(&self) -> usize {
        0
    }

    /// Log likelihoods of points that lie within the prior's bounds, in their order; the same for any batch.
    fn log_likelihoods(&self, points: &[Sample]) -> Result<Vec<f64>>;
}

/// Of every point: log density up to a constant, prior and likelihood together, and log likelihood. The likelihood is asked only where
/// the prior allows points; elsewhere, and where it is no number, both are minus infinity.
pub fn densities(target: &dyn Target, points: &[Sample], evaluations: &mut u64) -> Result<Vec<[f64; 2]>> {
    let prior = target.prior();
    let allowed: Vec<Sample> = points.iter().filter(|p| prior.allows(p)).cloned().collect();
    *evaluations += allowed.len() as u64;
    let mut found = target.log_likelihoods(&allowed)?.into_iter();
    let of = |p: &Sample| match prior.allows(p) {
        true => {
            let likelihood = found.next().filter(|l| !l.is_nan()).unwrap_or(f64::NEG_INFINITY);
            [prior.log_density(p) + likelihood, likelihood]
        }
        false => [f64::NEG_INFINITY; 2],
    };
    Ok(points.iter().map(of).collect())
}

/// Points drawn from a target, equally likely.
#[derive(Clone, Debug, PartialEq)]
pub struct Draws {
    pub points: Vec<Sample>,
    /// Log likelihood of each point.
    pub log_likelihoods: Vec<f64>,
    /// Which of several independent runs (or chains) each is of.
    pub run: Vec<usize>,
    /// Log evidence by run, as far as the method tells it.
    pub log_evidence: Vec<f64>,
    /// Likelihoods that were evaluated.
    pub evaluations: u64,
    pub quality: Quality,
}

/// Mean and covariance of weighted points; the weights sum to 1.
fn moments(points: &[Sample], weights: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
    let d = points.first().map_or(0, Vec::len);
    let mut mean = DVector::zeros(d);
    for (point, w) in points.iter().zip(weights) {
        mean.iter_mut().zip(point).for_each(|(m, x)| *m += w * x);
    }
    let mut covariance = DMatrix::zeros(d, d);
    for (point, w) in points.iter().zip(weights) {
        let off = DVector::from_fn(d, |i, _| point[i] - mean[i]);
        covariance.syger(*w, &off, &off, 1.0);
    }
    covariance.fill_upper_triangle_with_lower_triangle();
    (mean, covariance)
}

/// ln(sum(exp(values))), whatever their size; minus infinity of nothing.
pub fn log_sum_exp(values: impl IntoIterator<Item = f64> + Clone) -> f64 {
    let most = values.clone().into_iter().fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY {
        return most;
    }
    most + libm::log(values.into_iter().map(|v| libm::exp(v - most)).sum::<f64>())
}

/// One of several, drawn by the logarithms of their weights; `None` where there is none that may be. One alone is drawn
/// without a number of the stream.
pub fn one_of(log_weights: &[f64], stream: &mut Stream) -> Option<usize> {
    if log_weights.len() == 1 {
        return Some(0);
    }
    let all = log_sum_exp(log_weights.iter().copied());
    let mut rest: f64 = stream.random();
    let met = log_weights.iter().position(|l| {
        rest -= libm::exp(l - all);
        rest < 0.0
    });
    // Where rounding leaves something over it is the last that may be.
    met.or_else(|| log_weights.iter().rposition(|l| l.is_finite()))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A tilted normal density in two numbers, and a third that nothing tells.
    pub struct Tilted {
        pub prior: Prior,
    }

    /// Mean and covariance of the first two.
    pub const MEAN: [f64; 2] = [0.4, 0.7];
    pub const COVARIANCE: [[f64; 2]; 2] = [[4e-4, -2.4e-4], [-2.4e-4, 2.5e-4]];

    impl Tilted {
        pub fn new() -> Tilted {
            let wide = |low, high| Marginal::Uniform { low, high };
            let third = Marginal::Normal { mean: 1.0, sd: 0.5, low: 0.01, high: 100.0 };
            Tilted { prior: Prior::new(vec![wide(0.0, 2.0), wide(0.0, 1.0), third]).unwrap() }
        }

        /// Log of the integral of the likelihood times the prior.
        pub fn log_evidence() -> f64 {
            let [[a, b], [_, c]] = COVARIANCE;
            0.5 * ((2.0 * std::f64::consts::PI).powi(2) * (a * c - b * b)).ln() - 2f64.ln()
        }
    }

    impl Target for Tilted {
        fn prior(&self) -> &Prior {
            &self.prior
        }

        fn log_likelihoods(&self, points: &[Sample]) -> Result<Vec<f64>> {
            let [[a, b], [_, c]] = COVARIANCE;
            let det = a * c - b * b;
            let of = |p: &Sample| {
                let (x, y) = (p[0] - MEAN[0], p[1] - MEAN[1]);
                -0.5 * (c * x * x - 2.0 * b * x * y + a * y * y) / det
            };
            Ok(points.iter().map(of).collect())
        }
    }

    #[test]
    fn moments_are_those_of_the_points() {
        let points = vec![vec![0.0, 1.0], vec![2.0, 5.0]];
        let (mean, covariance) = moments(&points, &[0.25, 0.75]);
        assert_eq!(mean.as_slice(), [1.5, 4.0]);
        assert!((covariance[(0, 1)] - 1.5).abs() < 1e-12 && (covariance[(1, 0)] - 1.5).abs() < 1e-12);
    }

    #[test]
    fn what_the_prior_forbids_is_not_asked() {
        let (target, mut asked) = (Tilted::new(), 0);
        let points =
            vec![vec![0.4, 0.7, 1.0], vec![0.4, 1.1, 1.0], vec![f64::NAN, 0.7, 1.0], vec![0.5, 0.7, 1.0]];
        let found = densities(&target, &points, &mut asked).unwrap();
        assert_eq!((asked, found[1], found[2]), (2, [f64::NEG_INFINITY; 2], [f64::NEG_INFINITY; 2]));
        assert_eq!(found[0], [target.prior.log_density(&points[0]), 0.0]);
        assert!(found[3][1] < -1.0 && found[3][0] < found[0][0]);
    }

    #[test]
    fn sums_of_what_is_too_small_to_be_a_number() {
        assert!((log_sum_exp([-1e4, -1e4]) - (-1e4 + 2f64.ln())).abs() < 1e-9);
        assert_eq!(log_sum_exp([]), f64::NEG_INFINITY);
    }
}
