//! How far draws can be trusted: whether independent runs agree, and how many independent draws they are worth.
//!
//! Sources: R-hat over split chains and effective sample size from autocorrelations (Gelman et al., Bayesian Data Analysis,
//! 3rd ed. 2013, section 11.4-5; Geyer, Stat. Sci. 7 (1992) 473, for where the sum ends).
//!
//! Differences from the source: neither ranks nor folding (Vehtari et al. 2021); numbers that never moved have an R-hat of 1 where
//! all runs stand at the same place, else an infinite one.

use serde::{Deserialize, Serialize};

use crate::world::Sample;

/// R-hat beyond which runs do not agree, and effective draws below which quantiles are rough.
pub const AGREES: f64 = 1.01;
pub const ENOUGH: f64 = 400.0;

/// Of every number, how far its draws can be trusted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Ratio of the spread of all draws to that within runs; 1 where runs agree.
    pub r_hat: Vec<f64>,
    /// Independent draws that all draws are worth.
    pub effective: Vec<f64>,
    /// Share of proposed moves that were taken.
    pub accepted: f64,
}

impl Quality {
    /// Whether runs agree and there are enough independent draws; else why not.
    pub fn verdict(&self) -> std::result::Result<(), String> {
        // What is no number is as bad as can be.
        let worst =
            self.r_hat.iter().map(|r| if r.is_nan() { f64::INFINITY } else { *r }).fold(1.0, f64::max);
        let fewest =
            self.effective.iter().map(|n| if n.is_nan() { 0.0 } else { *n }).fold(f64::INFINITY, f64::min);
        if worst > AGREES {
            return Err(format!(
                "independent runs do not agree: R-hat {worst:.3}, {AGREES} at most; try more draws"
            ));
        }
        if fewest < ENOUGH {
            return Err(format!(
                "only {fewest:.0} effective draws of some number, {ENOUGH} wanted; try more draws"
            ));
        }
        Ok(())
    }
}

/// R-hat of one number by runs of equal length (Gelman et al., equation 11.4).
pub fn r_hat(runs: &[Vec<f64>]) -> f64 {
    let n = runs.iter().map(Vec::len).min().unwrap_or(0) as f64;
    if runs.len() < 2 || n < 2.0 {
        return f64::INFINITY;
    }
    let means: Vec<f64> = runs.iter().map(|r| mean(r)).collect();
    let within = runs.iter().map(|r| variance(r)).sum::<f64>() / runs.len() as f64;
    let between = variance(&means);
    if within == 0.0 {
        return if between == 0.0 { 1.0 } else { f64::INFINITY };
    }
    (((n - 1.0) / n * within + between) / within).sqrt()
}

/// Effective draws of one number in chains of equal length, from their autocorrelations (Gelman et al., equation 11.8).
pub fn effective(chains: &[Vec<f64>]) -> f64 {
    let n = chains.iter().map(Vec::len).min().unwrap_or(0);
    let all = (n * chains.len()) as f64;
    if n < 4 {
        return all;
    }
    let means: Vec<f64> = chains.iter().map(|c| mean(&c[..n])).collect();
    let within = chains.iter().map(|c| variance(&c[..n])).sum::<f64>() / chains.len() as f64;
    let spread = if chains.len() > 1 { variance(&means) } else { 0.0 };
    let pooled = within * (n - 1) as f64 / n as f64 + spread;
    if pooled <= 0.0 {
        return all;
    }
    let correlation = |lag: usize| {
        let of = |c: &Vec<f64>| (lag..n).map(|i| (c[i] - c[i - lag]).powi(2)).sum::<f64>() / (n - lag) as f64;
        1.0 - chains.iter().map(of).sum::<f64>() / chains.len() as f64 / (2.0 * pooled)
    };
    let (mut sum, mut lag, mut before) = (0.0, 1, f64::INFINITY);
    while lag + 1 < n {
        // Sums of neighbours are positive and fall; where they do not, what is left is noise.
        let pair = (correlation(lag) + correlation(lag + 1)).min(before);
        if pair <= 0.0 {
            break;
        }
        sum += pair;
        before = pair;
        lag += 2;
    }
    (all / (1.0 + 2.0 * sum)).min(all)
}

/// Every chain in two halves, so that one that drifts disagrees with itself.
pub fn split(chains: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let halves = |c: &Vec<f64>| [c[..c.len() / 2].to_vec(), c[c.len() - c.len() / 2..].to_vec()];
    chains.iter().flat_map(halves).collect()
}

/// One number of points, by run.
pub fn by_run(points: &[Sample], run: &[usize], number: usize) -> Vec<Vec<f64>> {
    let count = run.iter().max().map_or(0, |r| r + 1);
    let mut out = vec![Vec::new(); count];
    points.iter().zip(run).for_each(|(p, r)| out[*r].push(p[number]));
    out
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len().max(2) - 1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng;
    use rand_distr::{Distribution, StandardNormal};

    /// An autoregressive chain of correlation r is worth (1 - r) / (1 + r) of as many independent draws.
    #[test]
    fn chains_are_worth_what_theory_says() {
        let mut stream = rng::stream(2, "chains");
        for r in [0.0, 0.5, 0.9] {
            let chain = |stream: &mut rng::Stream| {
                let mut x: f64 = StandardNormal.sample(stream);
                (0..20_000)
                    .map(|_| {
                        let z: f64 = StandardNormal.sample(stream);
                        x = r * x + (1.0f64 - r * r).sqrt() * z;
                        x
                    })
                    .collect::<Vec<f64>>()
            };
            let chains: Vec<Vec<f64>> = (0..4).map(|_| chain(&mut stream)).collect();
            let wanted = 80_000.0 * (1.0 - r) / (1.0 + r);
            let found = effective(&chains);
            assert!((found / wanted - 1.0).abs() < 0.2, "{r}: {found} for {wanted}");
            assert!(r_hat(&split(&chains)) < 1.03);
        }
    }

    #[test]
    fn chains_that_stand_apart_do_not_agree() {
        let chains = [vec![0.0, 0.1, 0.0, 0.1], vec![1.0, 1.1, 1.0, 1.1]];
        assert!(r_hat(&chains) > 5.0);
        assert_eq!(r_hat(&[vec![1.0; 5], vec![1.0; 5]]), 1.0);
        assert_eq!(r_hat(&[vec![1.0; 5], vec![2.0; 5]]), f64::INFINITY);
        let drift = [(0..100).map(f64::from).collect::<Vec<_>>()];
        assert!(r_hat(&split(&drift)) > 1.5);
    }

    #[test]
    fn nothing_is_called_converged_that_is_not() {
        let quality =
            |r: f64, n: f64| Quality { r_hat: vec![1.0, r], effective: vec![900.0, n], accepted: 0.3 };
        assert!(quality(1.005, 500.0).verdict().is_ok());
        assert!(quality(1.2, 500.0).verdict().unwrap_err().contains("do not agree"));
        assert!(quality(1.0, 50.0).verdict().unwrap_err().contains("50 effective"));
        assert!(quality(f64::NAN, 500.0).verdict().is_err());
    }
}
