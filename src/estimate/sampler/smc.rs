//! Tempered sequential Monte Carlo from a reference density near the fit to the posterior.
//!
//! The densities pi_b are proportional to q^(1-b) (p L)^b with q the reference, p the prior and L the
//! likelihood, for b from 0 to 1. Each next b keeps the effective sample size at half of the particles.
//! Particles are then resampled systematically and moved by Metropolis steps that leave pi_b invariant.
//!
//! Sources: Del Moral, Doucet and Jasra, J. R. Stat. Soc. B 68 (2006) 411 (sections 2.3 and 3.3.2); adaptive
//! temperatures: Jasra et al., Scand. J. Stat. 38 (2011) 1.
//!
//! Differences from the source: moves alternate between random walks and independence proposals, both scaled by
//! the particles' covariance (and single-parameter walks of random scale, if the target requests them). At the
//! last temperature particles move until they are decorrelated from their resampled positions. Several runs
//! provide convergence diagnostics. In low dimension the runs start near a pilot run of fewer particles, which
//! pays once for the many small temperature steps from an inaccurate fit; given the pilot, runs are
//! independent.

use nalgebra::DMatrix;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::diagnostics::{SamplingDiagnostics, group_by_run, r_hat};
use super::particles::{
    Particle, correlation_with_start, next_temperature, normalised_weights, systematic_resample,
};
use super::reference::{ReferenceDensity, StudentT};
use super::{PosteriorDraws, Target, log_densities, weighted_moments};
use crate::budget::Budget;
use crate::error::{Error, Result, check_range};
use crate::progress::Progress;
use crate::rng::{self, Stream};
use crate::world::ParameterVector;

/// Parameters of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SmcConfig {
    /// Particles per run.
    pub particles: usize,
    /// Number of independent runs.
    pub runs: usize,
    /// Metropolis moves per particle and temperature.
    pub moves: usize,
    /// Maximum number of moves at the last temperature.
    pub last_moves: usize,
    pub seed: u64,
}

/// Correlation with the resampled positions below which particles count as decorrelated.
const MAX_AUTOCORRELATION: f64 = 0.3;
/// Maximum number of temperatures; more than any reference near the posterior needs.
const MAX_TEMPERATURES: usize = 60;
/// Maximum number of moves per temperature.
const MAX_MOVES: usize = 1000;
/// Minimum scale of a single-parameter walk as a share of the prior's standard deviation.
const MIN_WALK_SCALE: f64 = 1e-3;
/// Particles of the pilot as a share of a run's, and their minimum number per parameter: fewer do not determine
/// a covariance.
const PILOT_FRACTION: f64 = 0.25;
const MIN_PARTICLES_PER_PARAMETER: usize = 8;
/// Scale inflation of the reference relative to the pilot's particles.
const PILOT_INFLATION: f64 = 1.5;
/// Scale inflation of independence proposals relative to the particles.
const PROPOSAL_INFLATION: f64 = 1.1;

impl SmcConfig {
    /// Four runs, about a thousand draws in total.
    pub fn standard(seed: u64) -> SmcConfig {
        SmcConfig { particles: 256, runs: 4, moves: 2, last_moves: 8, seed }
    }

    /// Errors name the parameter that is out of range.
    pub fn validate(&self) -> Result<()> {
        check_range("particles", self.particles as f64, 16.0, 100_000.0)?;
        check_range("runs", self.runs as f64, 2.0, 64.0)?;
        check_range("moves", self.moves as f64, 1.0, MAX_MOVES as f64)?;
        check_range("last_moves", self.last_moves as f64, self.moves as f64, MAX_MOVES as f64).map(drop)
    }

    /// The same with `times` as many moves, up to the limit.
    pub fn with_more_moves(&self, times: usize) -> SmcConfig {
        let of = |moves: usize| moves.saturating_mul(times).min(MAX_MOVES);
        SmcConfig { moves: of(self.moves), last_moves: of(self.last_moves), ..self.clone() }
    }
}

/// Samples the posterior of a target, starting from a reference density. The result depends on the seed and not
/// on batching.
pub fn smc(
    target: &dyn Target,
    reference: &ReferenceDensity,
    config: &SmcConfig,
    progress: &dyn Progress,
) -> Result<PosteriorDraws> {
    config.validate()?;
    let mut runs = Vec::with_capacity(config.runs);
    // The pilot's share of the progress is its share of particles.
    let thousandths = |runs: f64| (1000.0 * runs) as u64;
    let all = thousandths(PILOT_FRACTION + config.runs as f64);
    let report = |runs: f64| progress.report("sampling the posterior", thousandths(runs), all);
    let (reference, pilot_evaluations) = {
        let report = |temperature| report(PILOT_FRACTION * temperature);
        reference_from_pilot(target, reference, config, (&report, &progress))?
    };
    for number in 0..config.runs {
        let seed = rng::derive_seed(config.seed, "run", number as u64);
        let completed = PILOT_FRACTION + number as f64;
        runs.push(
            SmcRun::new(target, &reference, config, seed, &progress)
                .sample(&|temperature| report(completed + temperature))?,
        );
    }
    let mut draws = merge_runs(runs);
    draws.evaluations += pilot_evaluations;
    Ok(draws)
}

/// Reference density for the runs: the given one mixed with the pilot's particles, and the number of
/// evaluations used. Falls back to the given reference if the pilot has too few particles, fails or
/// degenerates.
fn reference_from_pilot(
    target: &dyn Target,
    reference: &ReferenceDensity,
    config: &SmcConfig,
    (report, budget): (&dyn Fn(f64) -> Result<()>, &dyn Budget),
) -> Result<(ReferenceDensity, u64)> {
    let particles = (PILOT_FRACTION * config.particles as f64) as usize;
    if particles < MIN_PARTICLES_PER_PARAMETER * target.prior().marginals().len() {
        return Ok((reference.clone(), 0));
    }
    let config = SmcConfig { particles, ..config.clone() };
    let seed = rng::derive_seed(config.seed, "pilot", 0);
    let mut run = SmcRun::new(target, reference, &config, seed, budget);
    let particles = match run.sample(report) {
        Ok(ended) => ended.particles,
        Err(Error::Failed(_)) => return Ok((reference.clone(), run.evaluations)),
        Err(proposal) => return Err(proposal),
    };
    let points: Vec<ParameterVector> = particles.into_iter().map(|p| p.position).collect();
    let is_constant = |k: usize| points.iter().all(|p| p[k] == points[0][k]);
    let near = match (0..points[0].len()).any(is_constant) {
        true => reference.clone(),
        false => reference.clone().with_points(&points, PILOT_INFLATION),
    };
    Ok((near, run.evaluations))
}

/// State of one run.
struct SmcRun<'a> {
    target: &'a dyn Target,
    reference: &'a ReferenceDensity,
    config: &'a SmcConfig,
    /// Ends the run early.
    budget: &'a dyn Budget,
    stream: Stream,
    evaluations: u64,
    /// Proposed and accepted moves.
    move_counts: [u64; 2],
}

/// Result of one run.
struct SmcRunResult {
    particles: Vec<Particle>,
    log_evidence: f64,
    effective: Vec<f64>,
    evaluations: u64,
    move_counts: [u64; 2],
}

impl<'a> SmcRun<'a> {
    fn new(
        target: &'a dyn Target,
        reference: &'a ReferenceDensity,
        config: &'a SmcConfig,
        seed: u64,
        budget: &'a dyn Budget,
    ) -> SmcRun<'a> {
        SmcRun {
            target,
            reference,
            config,
            budget,
            stream: rng::stream(seed, "smc"),
            evaluations: 0,
            move_counts: [0, 0],
        }
    }

    fn sample(&mut self, report: &dyn Fn(f64) -> Result<()>) -> Result<SmcRunResult> {
        let drawn = (0..self.config.particles).map(|_| self.reference.draw(&mut self.stream)).collect();
        let mut particles = self.evaluate(drawn)?;
        let (mut temperature, mut log_evidence) = (0.0, 0.0);
        for _ in 0..MAX_TEMPERATURES {
            report(temperature)?;
            let next = next_temperature(&particles, temperature)?;
            let (weights, gained) = normalised_weights(&particles, next - temperature);
            (temperature, log_evidence) = (next, log_evidence + gained);
            let scales = self.proposal_scales(&particles, &weights);
            let (chosen, ess) = systematic_resample(&particles, &weights, &mut self.stream);
            particles = chosen;
            if temperature < 1.0 {
                for k in 0..self.config.moves {
                    self.metropolis_step(&mut particles, temperature, &scales, k)?;
                }
                continue;
            }
            let effective = self.final_moves(&mut particles, &scales, ess)?;
            let (evaluations, move_counts) = (self.evaluations, self.move_counts);
            return Ok(SmcRunResult { particles, log_evidence, effective, evaluations, move_counts });
        }
        let lost = "tempering did not reach the posterior: it is too far from the fit; improve the fit first";
        Err(Error::Failed(lost.into()))
    }

    /// Evaluates the densities of points.
    fn evaluate(&mut self, points: Vec<ParameterVector>) -> Result<Vec<Particle>> {
        let found = log_densities(self.target, &points, &mut self.evaluations, self.budget)?;
        let particle = |(temperature, [log_target, likelihood]): (ParameterVector, [f64; 2])| Particle {
            log_reference: self.reference.log_density(&temperature),
            log_target,
            log_likelihood: likelihood,
            position: temperature,
        };
        Ok(points.into_iter().zip(found).map(particle).collect())
    }

    /// Proposal scales from the weighted particles.
    fn proposal_scales(&self, particles: &[Particle], weights: &[f64]) -> ProposalScales {
        let points: Vec<ParameterVector> = particles.iter().map(|p| p.position.clone()).collect();
        let (mean, covariance) = weighted_moments(&points, weights);
        let unit: Vec<f64> = self.target.prior().marginals().iter().map(|m| m.centre_and_sd()[1]).collect();
        let d = mean.len().max(1) as f64;
        let walk = &covariance * (2.38f64.powi(2) / d);
        let independent = StudentT::new(mean.clone(), &(&covariance * PROPOSAL_INFLATION.powi(2)), &unit);
        let root = StudentT::new(mean, &walk, &unit);
        ProposalScales { independent, walk: root.cholesky_factor().clone() }
    }

    /// One Metropolis move of every particle under pi_at: in turn an independence proposal, a random walk and,
    /// if the target has structural parameters, a walk of one of them.
    fn metropolis_step(
        &mut self,
        particles: &mut [Particle],
        temperature: f64,
        scales: &ProposalScales,
        number: usize,
    ) -> Result<()> {
        let alone = self.target.structural_parameters();
        let kind = number % if alone > 0 { 3 } else { 2 };
        let independent = kind == 0;
        let widths: Vec<f64> =
            self.target.prior().marginals()[..alone].iter().map(|m| m.centre_and_sd()[1]).collect();
        let mut propose = |p: &Particle| match kind {
            0 => scales.independent.draw(&mut self.stream),
            1 => scales.random_walk(&p.position, &mut self.stream),
            _ => walk_one_parameter(&p.position, &widths, &mut self.stream),
        };
        let proposed: Vec<ParameterVector> = particles.iter().map(&mut propose).collect();
        let proposed = self.evaluate(proposed)?;
        let density = |p: &Particle| (1.0 - temperature) * p.log_reference + temperature * p.log_target;
        for (particle, proposal) in particles.iter_mut().zip(proposed) {
            let mut ratio = density(&proposal) - density(particle);
            if independent {
                let of = |p: &Particle| scales.independent.log_density(&p.position);
                ratio += of(particle) - of(&proposal);
            }
            let u: f64 = self.stream.random();
            self.move_counts[0] += 1;
            if proposal.log_target > f64::NEG_INFINITY && libm::log(u) < ratio {
                self.move_counts[1] += 1;
                *particle = proposal;
            }
        }
        Ok(())
    }

    /// Moves particles at the last temperature until they are decorrelated; returns the effective sample size
    /// per parameter. `worth`: effective sample size after resampling.
    fn final_moves(
        &mut self,
        particles: &mut [Particle],
        scales: &ProposalScales,
        ess: f64,
    ) -> Result<Vec<f64>> {
        let before: Vec<ParameterVector> = particles.iter().map(|p| p.position.clone()).collect();
        let n = particles.len() as f64;
        let d = before.first().map_or(0, Vec::len);
        let mut correlations = vec![1.0; d];
        for k in 0..self.config.last_moves {
            self.metropolis_step(particles, 1.0, scales, k)?;
            correlations = (0..d).map(|i| correlation_with_start(&before, particles, i)).collect();
            if k + 1 >= self.config.moves && correlations.iter().all(|c| *c < MAX_AUTOCORRELATION) {
                break;
            }
        }
        // Particles of one ancestor are correlated by what remains of their common position.
        Ok(correlations.iter().map(|c| n / (1.0 + (n / ess - 1.0).max(0.0) * c.max(0.0).powi(2))).collect())
    }
}

/// Perturbs one parameter, with a log-uniform scale between its prior width and [`MIN_WALK_SCALE`] of it.
fn walk_one_parameter(from: &[f64], widths: &[f64], stream: &mut Stream) -> ParameterVector {
    let k = stream.random_range(0..widths.len());
    let u: f64 = stream.random();
    let z: f64 = StandardNormal.sample(stream);
    let mut out = from.to_vec();
    out[k] += widths[k] * libm::pow(MIN_WALK_SCALE, u) * z;
    out
}

/// Proposal distributions.
struct ProposalScales {
    independent: StudentT,
    /// Cholesky factor of the random walk's covariance.
    walk: DMatrix<f64>,
}

impl ProposalScales {
    fn random_walk(&self, from: &[f64], stream: &mut Stream) -> ParameterVector {
        let z = nalgebra::DVector::from_fn(from.len(), |_, _| StandardNormal.sample(stream));
        let step = &self.walk * z;
        from.iter().zip(step.iter()).map(|(x, s)| x + s).collect()
    }
}

/// Combines runs and computes their diagnostics.
fn merge_runs(runs: Vec<SmcRunResult>) -> PosteriorDraws {
    let d = runs.first().map_or(0, |r| r.effective.len());
    let sum = |k: usize| runs.iter().map(|r| r.move_counts[k]).sum::<u64>() as f64;
    let accepted = sum(1) / sum(0).max(1.0);
    let effective: Vec<f64> = (0..d).map(|i| runs.iter().map(|r| r.effective[i]).sum()).collect();
    let evaluations = runs.iter().map(|r| r.evaluations).sum();
    let log_evidence = runs.iter().map(|r| r.log_evidence).collect();
    let (mut points, mut log_likelihoods, mut run) = (Vec::new(), Vec::new(), Vec::new());
    for (number, ended) in runs.into_iter().enumerate() {
        for particle in ended.particles {
            points.push(particle.position);
            log_likelihoods.push(particle.log_likelihood);
            run.push(number);
        }
    }
    let r_hat = (0..d).map(|i| r_hat(&group_by_run(&points, &run, i))).collect();
    PosteriorDraws {
        points,
        log_likelihoods,
        run,
        log_evidence,
        evaluations,
        quality: SamplingDiagnostics { r_hat, effective, accepted },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::Unlimited;
    use crate::estimate::sampler::log_sum_exp;
    use crate::estimate::sampler::tests::{COVARIANCE, MEAN, TiltedNormal, assert_recovered};
    use crate::progress::NoProgress;

    fn reference(target: &TiltedNormal, fit: [f64; 3], wider: f64) -> ReferenceDensity {
        let mut covariance = DMatrix::identity(3, 3) * 1e8;
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            covariance[(i, j)] = COVARIANCE[i][j];
        }
        for k in 0..2 {
            covariance[(2, k)] = 0.0;
            covariance[(k, 2)] = 0.0;
        }
        ReferenceDensity::new(&fit, &covariance, wider, target.prior())
    }

    /// Recovers mean, covariance and evidence of a known density, from a correct fit and from an inaccurate
    /// one.
    #[test]
    fn recovers_a_known_density() {
        let target = TiltedNormal::new();
        for fit in [[MEAN[0], MEAN[1], 1.0], [1.3, 0.2, 3.0]] {
            let reference = reference(&target, fit, 1.5);
            let config = SmcConfig { particles: 1000, ..SmcConfig::standard(3) };
            let draws = smc(&target, &reference, &config, &NoProgress).unwrap();
            let (mean, covariance) = assert_recovered(&draws);
            let tilt = covariance[(0, 1)] / (covariance[(0, 0)] * covariance[(1, 1)]).sqrt();
            assert!((tilt + 0.759).abs() < 0.05, "{tilt}");
            // The unidentified parameter keeps its prior.
            assert!(
                (mean[2] - 1.0).abs() < 0.06 && (covariance[(2, 2)].sqrt() - 0.48).abs() < 0.06,
                "{mean}"
            );
            let evidence = log_sum_exp(draws.log_evidence.iter().copied()) - 4f64.ln();
            assert!((evidence - TiltedNormal::log_evidence()).abs() < 0.2, "{evidence}");
            assert!(draws.quality.verdict().is_ok(), "{:?}", draws.quality);
        }
    }

    /// Single-parameter moves leave the density invariant.
    #[test]
    fn structural_moves_leave_the_density_invariant() {
        struct WithStructural(TiltedNormal);
        impl Target for WithStructural {
            fn prior(&self) -> &crate::estimate::sampler::JointPrior {
                self.0.prior()
            }
            fn structural_parameters(&self) -> usize {
                3
            }
            fn log_likelihoods(&self, points: &[ParameterVector], budget: &dyn Budget) -> Result<Vec<f64>> {
                self.0.log_likelihoods(points, budget)
            }
        }
        let target = WithStructural(TiltedNormal::new());
        let reference = reference(&target.0, [1.3, 0.2, 3.0], 1.5);
        let config = SmcConfig { particles: 1000, moves: 3, last_moves: 12, ..SmcConfig::standard(5) };
        let draws = smc(&target, &reference, &config, &NoProgress).unwrap();
        let (mean, covariance) = assert_recovered(&draws);
        assert!((mean[2] - 1.0).abs() < 0.06 && (covariance[(2, 2)].sqrt() - 0.48).abs() < 0.06, "{mean}");
        let mut stream = rng::stream(2, "walk");
        let walked: Vec<ParameterVector> =
            (0..200).map(|_| walk_one_parameter(&[0.5, 0.5], &[1.0, 2.0], &mut stream)).collect();
        assert!(walked.iter().all(|p| (p[0] == 0.5) != (p[1] == 0.5)), "one parameter moves");
    }

    #[test]
    fn seed_determines_every_bit() {
        let target = TiltedNormal::new();
        let reference = reference(&target, [0.5, 0.6, 1.0], 2.0);
        // Without and with a pilot.
        for particles in [64, 128] {
            let run = |seed| {
                let config = SmcConfig { particles, ..SmcConfig::standard(seed) };
                smc(&target, &reference, &config, &NoProgress).unwrap()
            };
            assert_eq!(run(8), run(8));
            assert_ne!(run(8).points, run(9).points);
        }
    }

    /// From an inaccurate reference, the pilot reduces the number of evaluations.
    #[test]
    fn pilot_reduces_evaluations() {
        let target = TiltedNormal::new();
        let reference = reference(&target, [1.3, 0.2, 3.0], 1.5);
        let config = SmcConfig { particles: 256, ..SmcConfig::standard(3) };
        let piloted = smc(&target, &reference, &config, &NoProgress).unwrap();
        let alone = SmcRun::new(&target, &reference, &config, 3, &Unlimited).sample(&|_| Ok(())).unwrap();
        assert!(
            piloted.evaluations < 4 * alone.evaluations * 3 / 4,
            "{} {}",
            piloted.evaluations,
            alone.evaluations
        );
    }

    #[test]
    fn rejects_invalid_config() {
        let config = SmcConfig { runs: 1, ..SmcConfig::standard(0) };
        assert!(config.validate().unwrap_err().to_string().contains("runs"));
        assert!(SmcConfig { particles: 3, ..SmcConfig::standard(0) }.validate().is_err());
    }
}
