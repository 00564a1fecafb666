//! Particles of sequential Monte Carlo: what they weigh at the next temperature, which that is, and who goes on.
//!
//! Sources: as in [`super::smc`].

use rand::RngExt;

use super::log_sum_exp;
use crate::error::{Error, Result};
use crate::rng::Stream;
use crate::world::Sample;

/// Share of the particles' worth that a step of the temperature leaves.
const WORTH: f64 = 0.5;

/// A particle: where it stands and how likely that is.
#[derive(Clone)]
pub struct Particle {
    pub at: Sample,
    /// Log densities: of the reference, and of prior and likelihood together.
    pub begun: f64,
    pub wanted: f64,
    pub likelihood: f64,
}

/// Log weights of a step of the temperature.
fn log_weights(particles: &[Particle], by: f64) -> Vec<f64> {
    let of = |p: &Particle| if p.wanted == f64::NEG_INFINITY { p.wanted } else { by * (p.wanted - p.begun) };
    particles.iter().map(of).collect()
}

/// The next temperature: as high as leaves the particles worth enough.
pub fn next(particles: &[Particle], at: f64) -> Result<f64> {
    let wanted = WORTH * particles.iter().filter(|p| p.wanted > f64::NEG_INFINITY).count() as f64;
    if wanted < 1.0 {
        return Err(Error::Failed("no draw from the prior or about the fit is possible at all".into()));
    }
    let worth = |to: f64| {
        let logs = log_weights(particles, to - at);
        (2.0 * log_sum_exp(logs.iter().copied()) - log_sum_exp(logs.iter().map(|l| 2.0 * l))).exp()
    };
    if worth(1.0) >= wanted {
        return Ok(1.0);
    }
    let (mut low, mut high) = (at, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if worth(middle) >= wanted { low = middle } else { high = middle }
    }
    Ok(high)
}

/// Weights that sum to 1, and the logarithm of their mean before.
pub fn weights(particles: &[Particle], by: f64) -> (Vec<f64>, f64) {
    let logs = log_weights(particles, by);
    let sum = log_sum_exp(logs.iter().copied());
    let weights = logs.iter().map(|l| libm::exp(l - sum)).collect();
    (weights, sum - libm::log(particles.len() as f64))
}

/// Particles drawn by their weights, evenly; and how many different ones they are worth.
pub fn resampled(particles: &[Particle], weights: &[f64], stream: &mut Stream) -> (Vec<Particle>, f64) {
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
    let chosen =
        particles.iter().zip(&counts).flat_map(|(p, c)| std::iter::repeat_n(p.clone(), *c)).collect();
    (chosen, (n * n) as f64 / squares as f64)
}

/// How much a number still tells of where particles stood.
pub fn correlation(before: &[Sample], after: &[Particle], number: usize) -> f64 {
    let n = before.len() as f64;
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / n;
    let a = mean(&mut before.iter().map(|p| p[number]));
    let b = mean(&mut after.iter().map(|p| p.at[number]));
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (p, q) in before.iter().zip(after) {
        let (x, y) = (p[number] - a, q.at[number] - b);
        ab += x * y;
        aa += x * x;
        bb += y * y;
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 1.0 }
}
