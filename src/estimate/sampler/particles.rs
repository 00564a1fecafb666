//! Particles of sequential Monte Carlo: weights, adaptive temperature and resampling.

use rand::RngExt;

use super::log_sum_exp;
use crate::error::{Error, Result};
use crate::rng::Stream;
use crate::world::ParameterVector;

/// Effective sample size to keep at a temperature step, as a share of the particles.
const ESS_FRACTION: f64 = 0.5;

/// A particle: position and log densities.
#[derive(Clone)]
pub struct Particle {
    pub position: ParameterVector,
    /// Log density of the reference.
    pub log_reference: f64,
    pub log_target: f64,
    pub log_likelihood: f64,
}

/// Incremental log weights of a temperature step.
fn log_weights(particles: &[Particle], by: f64) -> Vec<f64> {
    let of = |p: &Particle| {
        if p.log_target == f64::NEG_INFINITY { p.log_target } else { by * (p.log_target - p.log_reference) }
    };
    particles.iter().map(of).collect()
}

/// The highest next temperature that keeps the effective sample size.
pub fn next_temperature(particles: &[Particle], at: f64) -> Result<f64> {
    let target_ess =
        ESS_FRACTION * particles.iter().filter(|p| p.log_target > f64::NEG_INFINITY).count() as f64;
    if target_ess < 1.0 {
        return Err(Error::Failed(
            "no draw from the prior or near the fit has a finite posterior density".into(),
        ));
    }
    let ess = |to: f64| {
        let logs = log_weights(particles, to - at);
        (2.0 * log_sum_exp(logs.iter().copied()) - log_sum_exp(logs.iter().map(|l| 2.0 * l))).exp()
    };
    if ess(1.0) >= target_ess {
        return Ok(1.0);
    }
    let (mut low, mut high) = (at, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if ess(middle) >= target_ess { low = middle } else { high = middle }
    }
    Ok(high)
}

/// Normalised weights, and the log of their mean before normalisation.
pub fn normalised_weights(particles: &[Particle], by: f64) -> (Vec<f64>, f64) {
    let logs = log_weights(particles, by);
    let sum = log_sum_exp(logs.iter().copied());
    let weights = logs.iter().map(|l| libm::exp(l - sum)).collect();
    (weights, sum - libm::log(particles.len() as f64))
}

/// Systematic resampling; also returns the effective number of distinct particles.
pub fn systematic_resample(
    particles: &[Particle],
    weights: &[f64],
    stream: &mut Stream,
) -> (Vec<Particle>, f64) {
    let n = particles.len();
    let offset: f64 = stream.random();
    let mut counts = vec![0usize; n];
    let (mut i, mut sum) = (0, weights[0]);
    for k in 0..n {
        let at = (k as f64 + offset) / n as f64;
        while sum < at && i + 1 < n {
            i += 1;
            sum += weights[i];
        }
        counts[i] += 1;
    }
    let squares: usize = counts.iter().map(|c| c * c).sum();
    let resampled =
        particles.iter().zip(&counts).flat_map(|(p, c)| std::iter::repeat_n(p.clone(), *c)).collect();
    (resampled, (n * n) as f64 / squares as f64)
}

/// Correlation of a parameter with its value at the start.
pub fn correlation_with_start(before: &[ParameterVector], after: &[Particle], number: usize) -> f64 {
    let n = before.len() as f64;
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / n;
    let a = mean(&mut before.iter().map(|p| p[number]));
    let b = mean(&mut after.iter().map(|p| p.position[number]));
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (p, q) in before.iter().zip(after) {
        let (x, y) = (p[number] - a, q.position[number] - b);
        ab += x * y;
        aa += x * x;
        bb += y * y;
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 1.0 }
}
