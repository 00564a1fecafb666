//! Markov chains by random-walk Metropolis steps, many of them beside each other.
//!
//! A chain at x proposes x + z with z normal, of 2.38^2 / d times the covariance that all chains showed while they warmed up, and
//! goes there with probability min(1, pi(x') / pi(x)).
//!
//! Sources: Metropolis et al., J. Chem. Phys. 21 (1953) 1087; scale: Roberts, Gelman and Gilks, Ann. Appl. Probab. 7 (1997) 110;
//! adaptation: Haario, Saksman and Tamminen, Bernoulli 7 (2001) 223. Galileo (Wu et al., NeurIPS 2015) infers latents of physics
//! from what was seen in this way, a simulator in the likelihood.
//!
//! Differences from the source: chains stand side by side so that likelihoods come in batches, and adapt together, only while they
//! warm up (afterwards the chain is Markov's).

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::quality::{Quality, by_run, effective, r_hat, split};
use super::reference::{Reference, Student};
use super::start::starts;
use super::{Draws, Target, densities, moments};
use crate::error::{Result, within};
use crate::progress::Progress;
use crate::rng;
use crate::world::Sample;

/// Knobs of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct McmcConfig {
    /// Chains side by side.
    pub chains: usize,
    /// Steps of a chain in which it warms up, and those that are kept after.
    pub warm_up: usize,
    pub steps: usize,
    pub seed: u64,
}

/// Steps between two adaptations.
const ADAPTED: usize = 25;
/// Share of steps taken that is aimed at (in one number 0.44, in many 0.234).
const TAKEN: f64 = 0.3;

impl McmcConfig {
    /// 16 chains of 200 steps to warm up and 400 that are kept.
    pub fn standard(seed: u64) -> McmcConfig {
        McmcConfig { chains: 16, warm_up: 200, steps: 400, seed }
    }

    /// Errors name what is out of range.
    pub fn validate(&self) -> Result<()> {
        within("chains", self.chains as f64, 2.0, 1000.0)?;
        within("warm_up", self.warm_up as f64, ADAPTED as f64, 1e6)?;
        within("steps", self.steps as f64, 8.0, 1e6).map(drop)
    }
}

/// Draws from the posterior of a target by chains that begin where a reference says.
pub fn mcmc(
    target: &dyn Target,
    reference: &Reference,
    config: &McmcConfig,
    progress: &dyn Progress,
) -> Result<Draws> {
    config.validate()?;
    let mut stream = rng::stream(config.seed, "mcmc");
    let mut evaluations = 0;
    let first = starts(target, reference, config.chains, &mut stream, &mut evaluations)?;
    let (mut at, mut density): (Vec<Sample>, Vec<[f64; 2]>) = first.into_iter().unzip();
    let unit: Vec<f64> = target.prior().marginals().iter().map(|m| m.centre()[1]).collect();
    let (mut walk, mut scale) = (walk(&at, &unit), 1.0);
    let (mut seen, mut taken, mut moved) = (Vec::new(), 0usize, 0u64);
    let (mut points, mut log_likelihoods, mut run) = (Vec::new(), Vec::new(), Vec::new());
    for step in 0..config.warm_up + config.steps {
        progress.report("running Markov chains", step as u64, (config.warm_up + config.steps) as u64)?;
        let mut propose = |x: &Sample| -> Sample {
            let z = DVector::from_fn(x.len(), |_, _| StandardNormal.sample(&mut stream));
            let by = &walk * z * scale;
            x.iter().zip(by.iter()).map(|(x, s)| x + s).collect()
        };
        let proposed: Vec<Sample> = at.iter().map(&mut propose).collect();
        let there = densities(target, &proposed, &mut evaluations)?;
        let warm = step >= config.warm_up;
        for (c, (x, p)) in proposed.into_iter().zip(there).enumerate() {
            let u: f64 = stream.random();
            if p[0] > f64::NEG_INFINITY && libm::log(u) < p[0] - density[c][0] {
                (at[c], density[c]) = (x, p);
                taken += 1;
                moved += u64::from(warm);
            }
            match warm {
                true => {
                    points.push(at[c].clone());
                    log_likelihoods.push(density[c][1]);
                    run.push(c);
                }
                false => seen.push(at[c].clone()),
            }
        }
        if !warm && (step + 1).is_multiple_of(ADAPTED) {
            // The later half of what was seen: the way there is none of the posterior.
            walk = self::walk(&seen[seen.len() / 2..], &unit);
            let share = taken as f64 / (ADAPTED * config.chains) as f64;
            scale = (scale * libm::exp(share - TAKEN)).clamp(0.05, 5.0);
            taken = 0;
        }
    }
    let accepted = moved as f64 / (config.steps * config.chains) as f64;
    let quality = quality(&points, &run, accepted);
    Ok(Draws { points, log_likelihoods, run, log_evidence: Vec::new(), evaluations, quality })
}

/// How far chains can be trusted.
fn quality(points: &[Sample], run: &[usize], accepted: f64) -> Quality {
    let chains = |i: usize| split(&by_run(points, run, i));
    let d = points.first().map_or(0, Vec::len);
    Quality {
        r_hat: (0..d).map(|i| r_hat(&chains(i))).collect(),
        effective: (0..d).map(|i| effective(&chains(i))).collect(),
        accepted,
    }
}

/// Lower factor of a random walk's covariance among points.
fn walk(points: &[Sample], unit: &[f64]) -> DMatrix<f64> {
    let weights = vec![1.0 / points.len().max(1) as f64; points.len()];
    let (mean, covariance) = moments(points, &weights);
    let d = mean.len().max(1) as f64;
    Student::new(mean, &(covariance * (2.38f64.powi(2) / d)), unit).root().clone()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampler::tests::{COVARIANCE, MEAN, Tilted};
    use crate::progress::Silent;

    #[test]
    fn a_known_density_is_drawn_from() {
        let target = Tilted::new();
        let reference =
            Reference::new(&[0.6, 0.5, 1.0], &(DMatrix::identity(3, 3) * 0.01), 1.0, target.prior());
        let config = McmcConfig { steps: 3000, ..McmcConfig::standard(5) };
        let draws = mcmc(&target, &reference, &config, &Silent).unwrap();
        let weights = vec![1.0 / draws.points.len() as f64; draws.points.len()];
        let (mean, covariance) = moments(&draws.points, &weights);
        for i in 0..2 {
            let sd = COVARIANCE[i][i].sqrt();
            assert!((mean[i] - MEAN[i]).abs() < 0.1 * sd, "{mean}");
            assert!((covariance[(i, i)].sqrt() / sd - 1.0).abs() < 0.1, "{covariance}");
        }
        assert!((mean[2] - 1.0).abs() < 0.1, "{mean}");
        assert!(draws.quality.verdict().is_ok(), "{:?}", draws.quality);
        let again = mcmc(&target, &reference, &config, &Silent).unwrap();
        assert_eq!(draws, again, "a seed decides every bit");
    }

    #[test]
    fn too_few_steps_are_not_called_enough() {
        let target = Tilted::new();
        let reference =
            Reference::new(&[1.5, 0.5, 1.0], &(DMatrix::identity(3, 3) * 0.01), 1.0, target.prior());
        let config = McmcConfig { chains: 4, warm_up: 25, steps: 20, seed: 1 };
        let draws = mcmc(&target, &reference, &config, &Silent).unwrap();
        assert!(draws.quality.verdict().is_err(), "{:?}", draws.quality);
    }
}
