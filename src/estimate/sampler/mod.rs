//! Posterior samplers for log densities that are evaluated in batches.
//!
//! - [`prior`]: independent priors of the parameters.
//! - [`smc`]: sequential Monte Carlo from a reference density near the fit.
//! - [`mcmc`]: random-walk Metropolis chains, started by [`initial_points`].
//! - [`diagnostics`]: R-hat and effective sample size.
//!
//! All are pure functions: a [`Target`] evaluates log densities, and a seed determines every draw.

pub mod diagnostics;
pub mod initial_points;
pub mod mcmc;
mod particles;
pub mod prior;
pub mod reference;
pub mod smc;

use nalgebra::{DMatrix, DVector};
use rand::RngExt;

use crate::budget::Budget;
use crate::error::Result;
use crate::rng::Stream;
use crate::world::ParameterVector;
pub use diagnostics::SamplingDiagnostics;
pub use prior::{JointPrior, Marginal};
pub use reference::ReferenceDensity;

/// An unnormalised target density.
pub trait Target: Sync {
    /// The prior.
    fn prior(&self) -> &JointPrior;

    /// Number of leading parameters that are also updated one at a time: weakly identified ones, in front of a
    /// block of many others.
    fn structural_parameters(&self) -> usize {
        0
    }

    /// Log likelihoods of points within the prior's bounds, in order; independent of batching. Ends early with `budget`.
    fn log_likelihoods(&self, points: &[ParameterVector], budget: &dyn Budget) -> Result<Vec<f64>>;
}

/// For every point the unnormalised log posterior density and the log likelihood. The likelihood is evaluated
/// only where the prior density is positive; elsewhere, and where it is NaN, both are minus infinity.
pub fn log_densities(
    target: &dyn Target,
    points: &[ParameterVector],
    evaluations: &mut u64,
    budget: &dyn Budget,
) -> Result<Vec<[f64; 2]>> {
    let prior = target.prior();
    let inside: Vec<ParameterVector> = points.iter().filter(|p| prior.contains(p)).cloned().collect();
    *evaluations += inside.len() as u64;
    let mut found = target.log_likelihoods(&inside, budget)?.into_iter();
    let of = |p: &ParameterVector| match prior.contains(p) {
        true => {
            let likelihood = found.next().filter(|l| !l.is_nan()).unwrap_or(f64::NEG_INFINITY);
            [prior.log_density(p) + likelihood, likelihood]
        }
        false => [f64::NEG_INFINITY; 2],
    };
    Ok(points.iter().map(of).collect())
}

/// Equally weighted draws from a target.
#[derive(Clone, Debug, PartialEq)]
pub struct PosteriorDraws {
    pub points: Vec<ParameterVector>,
    /// Log likelihood of each draw.
    pub log_likelihoods: Vec<f64>,
    /// Index of the independent run or chain of each draw.
    pub run: Vec<usize>,
    /// Log evidence of each run; empty for MCMC.
    pub log_evidence: Vec<f64>,
    /// Number of likelihood evaluations.
    pub evaluations: u64,
    pub quality: SamplingDiagnostics,
}

/// Weighted mean and covariance; the weights sum to 1.
fn weighted_moments(points: &[ParameterVector], weights: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
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

/// Stable ln(sum(exp(values))); minus infinity for no values.
pub fn log_sum_exp(values: impl IntoIterator<Item = f64> + Clone) -> f64 {
    let maximum = values.clone().into_iter().fold(f64::NEG_INFINITY, f64::max);
    if maximum == f64::NEG_INFINITY {
        return maximum;
    }
    maximum + libm::log(values.into_iter().map(|v| libm::exp(v - maximum)).sum::<f64>())
}

/// Draws an index with the given log weights; `None` if all weights are zero. A single option uses no random
/// number.
pub fn sample_categorical(log_weights: &[f64], stream: &mut Stream) -> Option<usize> {
    if log_weights.len() == 1 {
        return Some(0);
    }
    let all = log_sum_exp(log_weights.iter().copied());
    let mut rest: f64 = stream.random();
    let index = log_weights.iter().position(|l| {
        rest -= libm::exp(l - all);
        rest < 0.0
    });
    // If rounding leaves a remainder, the last option with positive weight.
    index.or_else(|| log_weights.iter().rposition(|l| l.is_finite()))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::budget::Unlimited;

    /// A correlated normal likelihood of two parameters; a third is not identified.
    pub struct TiltedNormal {
        pub prior: JointPrior,
    }

    /// Mean and covariance of the first two parameters.
    pub const MEAN: [f64; 2] = [0.4, 0.7];
    pub const COVARIANCE: [[f64; 2]; 2] = [[4e-4, -2.4e-4], [-2.4e-4, 2.5e-4]];

    impl TiltedNormal {
        pub fn new() -> TiltedNormal {
            let wide = |low, high| Marginal::Uniform { low, high };
            let third = Marginal::Normal { mean: 1.0, sd: 0.5, low: 0.01, high: 100.0 };
            TiltedNormal { prior: JointPrior::new(vec![wide(0.0, 2.0), wide(0.0, 1.0), third]).unwrap() }
        }

        /// Log marginal likelihood.
        pub fn log_evidence() -> f64 {
            let [[a, b], [_, c]] = COVARIANCE;
            0.5 * ((2.0 * std::f64::consts::PI).powi(2) * (a * c - b * b)).ln() - 2f64.ln()
        }
    }

    /// Asserts that draws have [`MEAN`] and [`COVARIANCE`]; returns the moments of all three parameters.
    pub fn assert_recovered(draws: &PosteriorDraws) -> (DVector<f64>, DMatrix<f64>) {
        let weights = vec![1.0 / draws.points.len() as f64; draws.points.len()];
        let (mean, covariance) = weighted_moments(&draws.points, &weights);
        for i in 0..2 {
            let sd = COVARIANCE[i][i].sqrt();
            assert!((mean[i] - MEAN[i]).abs() < 0.1 * sd, "{mean}");
            assert!((covariance[(i, i)].sqrt() / sd - 1.0).abs() < 0.1, "{covariance}");
        }
        (mean, covariance)
    }

    impl Target for TiltedNormal {
        fn prior(&self) -> &JointPrior {
            &self.prior
        }

        fn log_likelihoods(&self, points: &[ParameterVector], _: &dyn Budget) -> Result<Vec<f64>> {
            let [[a, b], [_, c]] = COVARIANCE;
            let det = a * c - b * b;
            let of = |p: &ParameterVector| {
                let (x, y) = (p[0] - MEAN[0], p[1] - MEAN[1]);
                -0.5 * (c * x * x - 2.0 * b * x * y + a * y * y) / det
            };
            Ok(points.iter().map(of).collect())
        }
    }

    #[test]
    fn weighted_moments_match_hand_computation() {
        let points = vec![vec![0.0, 1.0], vec![2.0, 5.0]];
        let (mean, covariance) = weighted_moments(&points, &[0.25, 0.75]);
        assert_eq!(mean.as_slice(), [1.5, 4.0]);
        assert!((covariance[(0, 1)] - 1.5).abs() < 1e-12 && (covariance[(1, 0)] - 1.5).abs() < 1e-12);
    }

    #[test]
    fn likelihood_is_not_evaluated_outside_the_prior() {
        let (target, mut evaluations) = (TiltedNormal::new(), 0);
        let points =
            vec![vec![0.4, 0.7, 1.0], vec![0.4, 1.1, 1.0], vec![f64::NAN, 0.7, 1.0], vec![0.5, 0.7, 1.0]];
        let found = log_densities(&target, &points, &mut evaluations, &Unlimited).unwrap();
        assert_eq!((evaluations, found[1], found[2]), (2, [f64::NEG_INFINITY; 2], [f64::NEG_INFINITY; 2]));
        assert_eq!(found[0], [target.prior.log_density(&points[0]), 0.0]);
        assert!(found[3][1] < -1.0 && found[3][0] < found[0][0]);
    }

    #[test]
    fn log_sum_exp_does_not_underflow() {
        assert!((log_sum_exp([-1e4, -1e4]) - (-1e4 + 2f64.ln())).abs() < 1e-9);
        assert_eq!(log_sum_exp([]), f64::NEG_INFINITY);
    }
}
