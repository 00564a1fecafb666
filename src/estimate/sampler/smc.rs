//! Sequential Monte Carlo: particles go from a reference near the fit to the posterior by tempering.
//!
//! The densities pi_b are proportional to q^(1-b) (p L)^b with q the reference, p the prior and L the likelihood, b from 0 to 1;
//! each next b is as large as leaves half of the particles' worth; particles are then drawn anew by their weights (systematically)
//! and moved by Metropolis steps that leave pi_b as it is.
//!
//! Sources: Del Moral, Doucet and Jasra, J. R. Stat. Soc. B 68 (2006) 411 (sections 2.3 and 3.3.2); choice of the next temperature
//! by effective sample size: Jasra et al., Scand. J. Stat. 38 (2011) 1.
//!
//! Differences from the source: moves are random walks and independent draws in turn, both scaled by where the particles stand (and
//! walks of one number by any scale, where a target asks for them); the last density is moved in until particles have forgotten where
//! they stood; several runs tell how far the result can be trusted. Where numbers are few they begin near a pilot of fewer particles, which
//! takes the many small steps of the temperature that a fit needs which is off, once for all of them: given the pilot, they are independent.

use nalgebra::DMatrix;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::particles::{Particle, correlation, next, resampled, weights};
use super::quality::{Quality, by_run, r_hat};
use super::reference::{Reference, Student};
use super::{Draws, Target, densities, moments};
use crate::error::{Error, Result, within};
use crate::progress::Progress;
use crate::rng::{self, Stream};
use crate::world::Sample;

/// Knobs of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SmcConfig {
    /// Particles of a run.
    pub particles: usize,
    /// Independent runs.
    pub runs: usize,
    /// Moves of every particle at a temperature.
    pub moves: usize,
    /// Most moves at the last one.
    pub last_moves: usize,
    pub seed: u64,
}

/// Correlation with where particles stood before, below which they have forgotten it.
const FORGOTTEN: f64 = 0.3;
/// Most temperatures: more than a reference that lies anywhere near needs.
const TEMPERATURES: usize = 60;
/// Most moves of a particle at a temperature.
const MOST_MOVES: usize = 1000;
/// Least share of its prior's width by which a number walks alone.
const NARROWEST: f64 = 1e-3;
/// Particles of a pilot, as a share of a run's; fewest of them for every number: of fewer no covariance is told.
const PILOT: f64 = 0.25;
const TELL: usize = 8;
/// By how much the reference is wider than a pilot's particles.
const ABOUT: f64 = 1.5;
/// By how much an independent draw is wider than the particles.
const WIDER: f64 = 1.1;

impl SmcConfig {
    /// Four runs, a thousand draws in all.
    pub fn standard(seed: u64) -> SmcConfig {
        SmcConfig { particles: 256, runs: 4, moves: 2, last_moves: 8, seed }
    }

    /// Errors name what is out of range.
    pub fn validate(&self) -> Result<()> {
        within("particles", self.particles as f64, 16.0, 100_000.0)?;
        within("runs", self.runs as f64, 2.0, 64.0)?;
        within("moves", self.moves as f64, 1.0, MOST_MOVES as f64)?;
        within("last_moves", self.last_moves as f64, self.moves as f64, MOST_MOVES as f64).map(drop)
    }

    /// The same with particles moved oftener, as far as is allowed.
    pub fn moving(&self, times: usize) -> SmcConfig {
        let of = |moves: usize| moves.saturating_mul(times).min(MOST_MOVES);
        SmcConfig { moves: of(self.moves), last_moves: of(self.last_moves), ..self.clone() }
    }
}

/// Draws from the posterior of a target, beginning near a reference. The result depends on the seed and not on how likelihoods are
/// evaluated.
pub fn smc(
    target: &dyn Target,
    reference: &Reference,
    config: &SmcConfig,
    progress: &dyn Progress,
) -> Result<Draws> {
    config.validate()?;
    let mut runs = Vec::with_capacity(config.runs);
    // The pilot counts as the part of a run that its particles are.
    let thousandths = |runs: f64| (1000.0 * runs) as u64;
    let all = thousandths(PILOT + config.runs as f64);
    let report = |runs: f64| progress.report("drawing from the posterior", thousandths(runs), all);
    let (reference, asked) = piloted(target, reference, config, &|at| report(PILOT * at))?;
    for number in 0..config.runs {
        let seed = rng::derive(config.seed, "run", number as u64);
        let begun = PILOT + number as f64;
        runs.push(Run::new(target, &reference, config, seed).go(&|at| report(begun + at))?);
    }
    let mut draws = joined(runs);
    draws.evaluations += asked;
    Ok(draws)
}

/// Where runs begin: the reference, and beside it where a pilot's particles ended; and how many likelihoods that took. The reference alone where
/// so few particles tell nothing, ended nowhere, or all in one place.
fn piloted(
    target: &dyn Target,
    reference: &Reference,
    config: &SmcConfig,
    report: &dyn Fn(f64) -> Result<()>,
) -> Result<(Reference, u64)> {
    let particles = (PILOT * config.particles as f64) as usize;
    if particles < TELL * target.prior().marginals().len() {
        return Ok((reference.clone(), 0));
    }
    let config = SmcConfig { particles, ..config.clone() };
    let seed = rng::derive(config.seed, "pilot", 0);
    let mut run = Run::new(target, reference, &config, seed);
    let particles = match run.go(report) {
        Ok(ended) => ended.particles,
        Err(Error::Failed(_)) => return Ok((reference.clone(), run.evaluations)),
        Err(other) => return Err(other),
    };
    let points: Vec<Sample> = particles.into_iter().map(|p| p.at).collect();
    let alike = |k: usize| points.iter().all(|p| p[k] == points[0][k]);
    let near = match (0..points[0].len()).any(alike) {
        true => reference.clone(),
        false => reference.clone().beside(&points, ABOUT),
    };
    Ok((near, run.evaluations))
}

/// One run.
struct Run<'a> {
    target: &'a dyn Target,
    reference: &'a Reference,
    config: &'a SmcConfig,
    stream: Stream,
    evaluations: u64,
    /// Moves that were proposed and taken.
    moved: [u64; 2],
}

/// What a run ends with.
struct Ended {
    particles: Vec<Particle>,
    log_evidence: f64,
    effective: Vec<f64>,
    evaluations: u64,
    moved: [u64; 2],
}

impl<'a> Run<'a> {
    fn new(target: &'a dyn Target, reference: &'a Reference, config: &'a SmcConfig, seed: u64) -> Run<'a> {
        Run { target, reference, config, stream: rng::stream(seed, "smc"), evaluations: 0, moved: [0, 0] }
    }

    fn go(&mut self, report: &dyn Fn(f64) -> Result<()>) -> Result<Ended> {
        let drawn = (0..self.config.particles).map(|_| self.reference.draw(&mut self.stream)).collect();
        let mut particles = self.weighed(drawn)?;
        let (mut at, mut log_evidence) = (0.0, 0.0);
        for _ in 0..TEMPERATURES {
            report(at)?;
            let next = next(&particles, at)?;
            let (weights, gained) = weights(&particles, next - at);
            (at, log_evidence) = (next, log_evidence + gained);
            let spread = self.spread(&particles, &weights);
            let (chosen, worth) = resampled(&particles, &weights, &mut self.stream);
            particles = chosen;
            if at < 1.0 {
                for k in 0..self.config.moves {
                    self.step(&mut particles, at, &spread, k)?;
                }
                continue;
            }
            let effective = self.settled(&mut particles, &spread, worth)?;
            let (evaluations, moved) = (self.evaluations, self.moved);
            return Ok(Ended { particles, log_evidence, effective, evaluations, moved });
        }
        let lost = "the posterior lies so far from the fit that tempering did not reach it; fit better first";
        Err(Error::Failed(lost.into()))
    }

    /// Points with their densities.
    fn weighed(&mut self, points: Vec<Sample>) -> Result<Vec<Particle>> {
        let found = densities(self.target, &points, &mut self.evaluations)?;
        let particle = |(at, [wanted, likelihood]): (Sample, [f64; 2])| Particle {
            begun: self.reference.log_density(&at),
            wanted,
            likelihood,
            at,
        };
        Ok(points.into_iter().zip(found).map(particle).collect())
    }

    /// How particles stand to each other: what moves are scaled by.
    fn spread(&self, particles: &[Particle], weights: &[f64]) -> Spread {
        let points: Vec<Sample> = particles.iter().map(|p| p.at.clone()).collect();
        let (mean, covariance) = moments(&points, weights);
        let unit: Vec<f64> = self.target.prior().marginals().iter().map(|m| m.centre()[1]).collect();
        let d = mean.len().max(1) as f64;
        let walk = &covariance * (2.38f64.powi(2) / d);
        let independent = Student::new(mean.clone(), &(&covariance * WIDER.powi(2)), &unit);
        let root = Student::new(mean, &walk, &unit);
        Spread { independent, walk: root.root().clone() }
    }

    /// One move of every particle under pi_at: an independent draw and a random walk in turn, and where numbers are worth moving alone a walk of
    /// one of them.
    fn step(&mut self, particles: &mut [Particle], at: f64, spread: &Spread, number: usize) -> Result<()> {
        let alone = self.target.alone();
        let kind = number % if alone > 0 { 3 } else { 2 };
        let independent = kind == 0;
        let widths: Vec<f64> =
            self.target.prior().marginals()[..alone].iter().map(|m| m.centre()[1]).collect();
        let mut propose = |p: &Particle| match kind {
            0 => spread.independent.draw(&mut self.stream),
            1 => spread.walked(&p.at, &mut self.stream),
            _ => one_walked(&p.at, &widths, &mut self.stream),
        };
        let proposed: Vec<Sample> = particles.iter().map(&mut propose).collect();
        let proposed = self.weighed(proposed)?;
        let density = |p: &Particle| (1.0 - at) * p.begun + at * p.wanted;
        for (particle, other) in particles.iter_mut().zip(proposed) {
            let mut ratio = density(&other) - density(particle);
            if independent {
                let of = |p: &Particle| spread.independent.log_density(&p.at);
                ratio += of(particle) - of(&other);
            }
            let u: f64 = self.stream.random();
            self.moved[0] += 1;
            if other.wanted > f64::NEG_INFINITY && libm::log(u) < ratio {
                self.moved[1] += 1;
                *particle = other;
            }
        }
        Ok(())
    }

    /// Moves particles at the last temperature until they have forgotten where they stood; how many independent draws each number's
    /// values are worth then. `worth`: what the particles were worth before.
    fn settled(&mut self, particles: &mut [Particle], spread: &Spread, worth: f64) -> Result<Vec<f64>> {
        let before: Vec<Sample> = particles.iter().map(|p| p.at.clone()).collect();
        let n = particles.len() as f64;
        let d = before.first().map_or(0, Vec::len);
        let mut kept = vec![1.0; d];
        for k in 0..self.config.last_moves {
            self.step(particles, 1.0, spread, k)?;
            kept = (0..d).map(|i| correlation(&before, particles, i)).collect();
            if k + 1 >= self.config.moves && kept.iter().all(|c| *c < FORGOTTEN) {
                break;
            }
        }
        // Particles of one ancestor are as much alike as they remember of it.
        Ok(kept.iter().map(|c| n / (1.0 + (n / worth - 1.0).max(0.0) * c.max(0.0).powi(2))).collect())
    }
}

/// A point of which one number has walked, by any share of its width from all of it down to [`NARROWEST`].
fn one_walked(from: &[f64], widths: &[f64], stream: &mut Stream) -> Sample {
    let k = stream.random_range(0..widths.len());
    let u: f64 = stream.random();
    let z: f64 = StandardNormal.sample(stream);
    let mut out = from.to_vec();
    out[k] += widths[k] * libm::pow(NARROWEST, u) * z;
    out
}

/// What moves are scaled by.
struct Spread {
    independent: Student,
    /// Lower factor of a random walk's covariance.
    walk: DMatrix<f64>,
}

impl Spread {
    fn walked(&self, from: &[f64], stream: &mut Stream) -> Sample {
        let z = nalgebra::DVector::from_fn(from.len(), |_, _| StandardNormal.sample(stream));
        let step = &self.walk * z;
        from.iter().zip(step.iter()).map(|(x, s)| x + s).collect()
    }
}

/// All runs' particles, and how far they agree.
fn joined(runs: Vec<Ended>) -> Draws {
    let d = runs.first().map_or(0, |r| r.effective.len());
    let sum = |k: usize| runs.iter().map(|r| r.moved[k]).sum::<u64>() as f64;
    let accepted = sum(1) / sum(0).max(1.0);
    let effective: Vec<f64> = (0..d).map(|i| runs.iter().map(|r| r.effective[i]).sum()).collect();
    let evaluations = runs.iter().map(|r| r.evaluations).sum();
    let log_evidence = runs.iter().map(|r| r.log_evidence).collect();
    let (mut points, mut log_likelihoods, mut run) = (Vec::new(), Vec::new(), Vec::new());
    for (number, ended) in runs.into_iter().enumerate() {
        for particle in ended.particles {
            points.push(particle.at);
            log_likelihoods.push(particle.likelihood);
            run.push(number);
        }
    }
    let r_hat = (0..d).map(|i| r_hat(&by_run(&points, &run, i))).collect();
    Draws {
        points,
        log_likelihoods,
        run,
        log_evidence,
        evaluations,
        quality: Quality { r_hat, effective, accepted },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampler::log_sum_exp;
    use crate::estimate::sampler::tests::{COVARIANCE, MEAN, Tilted};
    use crate::progress::Silent;

    fn reference(target: &Tilted, fit: [f64; 3], wider: f64) -> Reference {
        let mut covariance = DMatrix::identity(3, 3) * 1e8;
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            covariance[(i, j)] = COVARIANCE[i][j];
        }
        for k in 0..2 {
            covariance[(2, k)] = 0.0;
            covariance[(k, 2)] = 0.0;
        }
        Reference::new(&fit, &covariance, wider, target.prior())
    }

    /// Means, spreads and evidence of a density that is known, from a fit that is right and from one that is off.
    #[test]
    fn a_known_density_is_drawn_from() {
        let target = Tilted::new();
        for fit in [[MEAN[0], MEAN[1], 1.0], [1.3, 0.2, 3.0]] {
            let reference = reference(&target, fit, 1.5);
            let config = SmcConfig { particles: 1000, ..SmcConfig::standard(3) };
            let draws = smc(&target, &reference, &config, &Silent).unwrap();
            let weights = vec![1.0 / draws.points.len() as f64; draws.points.len()];
            let (mean, covariance) = moments(&draws.points, &weights);
            for i in 0..2 {
                let sd = COVARIANCE[i][i].sqrt();
                assert!((mean[i] - MEAN[i]).abs() < 0.1 * sd, "{fit:?} {mean}");
                assert!((covariance[(i, i)].sqrt() / sd - 1.0).abs() < 0.1, "{fit:?} {covariance}");
            }
            let tilt = covariance[(0, 1)] / (covariance[(0, 0)] * covariance[(1, 1)]).sqrt();
            assert!((tilt + 0.759).abs() < 0.05, "{tilt}");
            // What nothing tells stays as it was believed.
            assert!(
                (mean[2] - 1.0).abs() < 0.06 && (covariance[(2, 2)].sqrt() - 0.48).abs() < 0.06,
                "{mean}"
            );
            let evidence = log_sum_exp(draws.log_evidence.iter().copied()) - 4f64.ln();
            assert!((evidence - Tilted::log_evidence()).abs() < 0.2, "{evidence}");
            assert!(draws.quality.verdict().is_ok(), "{:?}", draws.quality);
        }
    }

    /// Moves of one number leave a density as it is, too.
    #[test]
    fn numbers_that_walk_alone_are_drawn_as_they_are() {
        struct Alone(Tilted);
        impl Target for Alone {
            fn prior(&self) -> &crate::estimate::sampler::Prior {
                self.0.prior()
            }
            fn alone(&self) -> usize {
                3
            }
            fn log_likelihoods(&self, points: &[Sample]) -> Result<Vec<f64>> {
                self.0.log_likelihoods(points)
            }
        }
        let target = Alone(Tilted::new());
        let reference = reference(&target.0, [1.3, 0.2, 3.0], 1.5);
        let config = SmcConfig { particles: 1000, moves: 3, last_moves: 12, ..SmcConfig::standard(5) };
        let draws = smc(&target, &reference, &config, &Silent).unwrap();
        let (mean, covariance) =
            moments(&draws.points, &vec![1.0 / draws.points.len() as f64; draws.points.len()]);
        for i in 0..2 {
            let sd = COVARIANCE[i][i].sqrt();
            assert!((mean[i] - MEAN[i]).abs() < 0.1 * sd, "{mean}");
            assert!((covariance[(i, i)].sqrt() / sd - 1.0).abs() < 0.1, "{covariance}");
        }
        assert!((mean[2] - 1.0).abs() < 0.06 && (covariance[(2, 2)].sqrt() - 0.48).abs() < 0.06, "{mean}");
        let mut stream = rng::stream(2, "walk");
        let walked: Vec<Sample> =
            (0..200).map(|_| one_walked(&[0.5, 0.5], &[1.0, 2.0], &mut stream)).collect();
        assert!(walked.iter().all(|p| (p[0] == 0.5) != (p[1] == 0.5)), "one number moves");
    }

    #[test]
    fn a_seed_decides_every_bit() {
        let target = Tilted::new();
        let reference = reference(&target, [0.5, 0.6, 1.0], 2.0);
        // Without a pilot, and with one.
        for particles in [64, 128] {
            let run = |seed| {
                let config = SmcConfig { particles, ..SmcConfig::standard(seed) };
                smc(&target, &reference, &config, &Silent).unwrap()
            };
            assert_eq!(run(8), run(8));
            assert_ne!(run(8).points, run(9).points);
        }
    }

    /// From a reference that is far off runs take fewer likelihoods than each would without what the pilot found.
    #[test]
    fn a_pilot_finds_the_way_once() {
        let target = Tilted::new();
        let reference = reference(&target, [1.3, 0.2, 3.0], 1.5);
        let config = SmcConfig { particles: 256, ..SmcConfig::standard(3) };
        let piloted = smc(&target, &reference, &config, &Silent).unwrap();
        let alone = Run::new(&target, &reference, &config, 3).go(&|_| Ok(())).unwrap();
        assert!(
            piloted.evaluations < 4 * alone.evaluations * 3 / 4,
            "{} {}",
            piloted.evaluations,
            alone.evaluations
        );
    }

    #[test]
    fn knobs_that_are_none_are_refused() {
        let config = SmcConfig { runs: 1, ..SmcConfig::standard(0) };
        assert!(config.validate().unwrap_err().to_string().contains("runs"));
        assert!(SmcConfig { particles: 3, ..SmcConfig::standard(0) }.validate().is_err());
    }
}
