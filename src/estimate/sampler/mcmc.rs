//! Random-walk Metropolis with many parallel chains.
//!
//! A chain at x proposes x + z with z normal, of 2.38^2 / d times the covariance of all chains during warm-up,
//! and accepts with probability min(1, pi(x') / pi(x)).
//!
//! Sources: Metropolis et al., J. Chem. Phys. 21 (1953) 1087; scale: Roberts, Gelman and Gilks, Ann. Appl.
//! Probab. 7 (1997) 110; adaptation: Haario, Saksman and Tamminen, Bernoulli 7 (2001) 223. Galileo (Wu et al.,
//! NeurIPS 2015) infers physical latents from observations in this way, with a simulator in the likelihood.
//!
//! Differences from the source: chains advance together so that likelihoods are evaluated in batches. They
//! share one adapted proposal, which is fixed after warm-up.

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::diagnostics::{SamplingDiagnostics, effective_sample_size, group_by_run, r_hat, split_chains};
use super::initial_points::initial_points;
use super::reference::{ReferenceDensity, StudentT};
use super::{PosteriorDraws, Target, log_densities, weighted_moments};
use crate::error::{Result, check_range};
use crate::progress::Progress;
use crate::rng;
use crate::world::ParameterVector;

/// Parameters of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct McmcConfig {
    /// Number of chains.
    pub chains: usize,
    /// Warm-up steps per chain; discarded.
    pub warm_up: usize,
    pub steps: usize,
    pub seed: u64,
}

/// Steps between two adaptations.
const ADAPTATION_INTERVAL: usize = 25;
/// Target acceptance rate (0.44 is optimal in one dimension, 0.234 in many).
const TARGET_ACCEPTANCE: f64 = 0.3;

impl McmcConfig {
    /// 16 chains with 200 warm-up steps and 400 draws each.
    pub fn standard(seed: u64) -> McmcConfig {
        McmcConfig { chains: 16, warm_up: 200, steps: 400, seed }
    }

    /// Errors name the parameter that is out of range.
    pub fn validate(&self) -> Result<()> {
        check_range("chains", self.chains as f64, 2.0, 1000.0)?;
        check_range("warm_up", self.warm_up as f64, ADAPTATION_INTERVAL as f64, 1e6)?;
        check_range("steps", self.steps as f64, 8.0, 1e6).map(drop)
    }
}

/// Samples the posterior of a target by chains started from a reference density.
pub fn mcmc(
    target: &dyn Target,
    reference: &ReferenceDensity,
    config: &McmcConfig,
    progress: &dyn Progress,
) -> Result<PosteriorDraws> {
    config.validate()?;
    let mut stream = rng::stream(config.seed, "mcmc");
    let mut evaluations = 0;
    let first = initial_points(target, reference, config.chains, &mut stream, &mut evaluations, &progress)?;
    let (mut positions, mut density): (Vec<ParameterVector>, Vec<[f64; 2]>) = first.into_iter().unzip();
    let unit: Vec<f64> = target.prior().marginals().iter().map(|m| m.centre_and_sd()[1]).collect();
    let (mut factor, mut scale) = (proposal_factor(&positions, &unit), 1.0);
    let (mut warm_up_points, mut accepted_in_window, mut accepted_total) = (Vec::new(), 0usize, 0u64);
    let (mut points, mut log_likelihoods, mut run) = (Vec::new(), Vec::new(), Vec::new());
    for step in 0..config.warm_up + config.steps {
        progress.report("running Markov chains", step as u64, (config.warm_up + config.steps) as u64)?;
        let mut propose = |x: &ParameterVector| -> ParameterVector {
            let z = DVector::from_fn(x.len(), |_, _| StandardNormal.sample(&mut stream));
            let by = &factor * z * scale;
            x.iter().zip(by.iter()).map(|(x, s)| x + s).collect()
        };
        let proposed: Vec<ParameterVector> = positions.iter().map(&mut propose).collect();
        let proposed_densities = log_densities(target, &proposed, &mut evaluations, &progress)?;
        let is_sampling = step >= config.warm_up;
        for (c, (x, p)) in proposed.into_iter().zip(proposed_densities).enumerate() {
            let u: f64 = stream.random();
            if p[0] > f64::NEG_INFINITY && libm::log(u) < p[0] - density[c][0] {
                (positions[c], density[c]) = (x, p);
                accepted_in_window += 1;
                accepted_total += u64::from(is_sampling);
            }
            match is_sampling {
                true => {
                    points.push(positions[c].clone());
                    log_likelihoods.push(density[c][1]);
                    run.push(c);
                }
                false => warm_up_points.push(positions[c].clone()),
            }
        }
        if !is_sampling && (step + 1).is_multiple_of(ADAPTATION_INTERVAL) {
            // Only the later half: the approach to the posterior is not part of it.
            factor = self::proposal_factor(&warm_up_points[warm_up_points.len() / 2..], &unit);
            let share = accepted_in_window as f64 / (ADAPTATION_INTERVAL * config.chains) as f64;
            scale = (scale * libm::exp(share - TARGET_ACCEPTANCE)).clamp(0.05, 5.0);
            accepted_in_window = 0;
        }
    }
    let accepted = accepted_total as f64 / (config.steps * config.chains) as f64;
    let quality = diagnostics(&points, &run, accepted);
    Ok(PosteriorDraws { points, log_likelihoods, run, log_evidence: Vec::new(), evaluations, quality })
}

/// Convergence diagnostics over split chains.
fn diagnostics(points: &[ParameterVector], run: &[usize], accepted: f64) -> SamplingDiagnostics {
    let chains = |i: usize| split_chains(&group_by_run(points, run, i));
    let d = points.first().map_or(0, Vec::len);
    SamplingDiagnostics {
        r_hat: (0..d).map(|i| r_hat(&chains(i))).collect(),
        effective: (0..d).map(|i| effective_sample_size(&chains(i))).collect(),
        accepted,
    }
}

/// Cholesky factor of the optimally scaled covariance of points.
fn proposal_factor(points: &[ParameterVector], unit: &[f64]) -> DMatrix<f64> {
    let weights = vec![1.0 / points.len().max(1) as f64; points.len()];
    let (mean, covariance) = weighted_moments(points, &weights);
    let d = mean.len().max(1) as f64;
    StudentT::new(mean, &(covariance * (2.38f64.powi(2) / d)), unit).cholesky_factor().clone()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampler::tests::{TiltedNormal, assert_recovered};
    use crate::progress::NoProgress;

    #[test]
    fn recovers_a_known_density() {
        let target = TiltedNormal::new();
        let reference =
            ReferenceDensity::new(&[0.6, 0.5, 1.0], &(DMatrix::identity(3, 3) * 0.01), 1.0, target.prior());
        let config = McmcConfig { steps: 3000, ..McmcConfig::standard(5) };
        let draws = mcmc(&target, &reference, &config, &NoProgress).unwrap();
        let (mean, _) = assert_recovered(&draws);
        assert!((mean[2] - 1.0).abs() < 0.1, "{mean}");
        assert!(draws.quality.verdict().is_ok(), "{:?}", draws.quality);
        let again = mcmc(&target, &reference, &config, &NoProgress).unwrap();
        assert_eq!(draws, again, "the seed determines every bit");
    }

    #[test]
    fn short_chains_fail_diagnostics() {
        let target = TiltedNormal::new();
        let reference =
            ReferenceDensity::new(&[1.5, 0.5, 1.0], &(DMatrix::identity(3, 3) * 0.01), 1.0, target.prior());
        let config = McmcConfig { chains: 4, warm_up: 25, steps: 20, seed: 1 };
        let draws = mcmc(&target, &reference, &config, &NoProgress).unwrap();
        assert!(draws.quality.verdict().is_err(), "{:?}", draws.quality);
    }
}
