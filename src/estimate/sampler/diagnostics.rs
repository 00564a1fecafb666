//! Convergence diagnostics: R-hat and effective sample size.
//!
//! Sources: R-hat over split chains and effective sample size from autocorrelations (Gelman et al., Bayesian
//! Data Analysis, 3rd ed. 2013, section 11.4-5); truncation of the autocorrelation sum: Geyer, Stat. Sci. 7
//! (1992) 473.
//!
//! Differences from the source: no rank normalisation or folding (Vehtari et al. 2021). A constant parameter
//! has R-hat 1 if all runs agree, otherwise infinity.

use serde::{Deserialize, Serialize};

use crate::world::ParameterVector;

/// Maximum R-hat, and minimum effective sample size for stable quantiles.
pub const MAX_R_HAT: f64 = 1.01;
pub const MIN_EFFECTIVE_SAMPLES: f64 = 400.0;

/// Convergence diagnostics per parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SamplingDiagnostics {
    /// Potential scale reduction factor; 1 if runs agree.
    pub r_hat: Vec<f64>,
    /// Effective sample size.
    pub effective: Vec<f64>,
    /// Acceptance rate of proposed moves.
    pub accepted: f64,
}

impl SamplingDiagnostics {
    /// Checks R-hat and effective sample size; the error explains a failure.
    pub fn verdict(&self) -> std::result::Result<(), String> {
        // NaN counts as the worst value.
        let largest_r_hat =
            self.r_hat.iter().map(|r| if r.is_nan() { f64::INFINITY } else { *r }).fold(1.0, f64::max);
        let smallest_ess =
            self.effective.iter().map(|n| if n.is_nan() { 0.0 } else { *n }).fold(f64::INFINITY, f64::min);
        if largest_r_hat > MAX_R_HAT {
            return Err(format!(
                "independent runs do not agree: R-hat is {largest_r_hat:.3}, at most {MAX_R_HAT} is allowed; increase the number of draws"
            ));
        }
        if smallest_ess < MIN_EFFECTIVE_SAMPLES {
            return Err(format!(
                "the smallest effective sample size is {smallest_ess:.0}, at least {MIN_EFFECTIVE_SAMPLES} are needed; increase the number of draws"
            ));
        }
        Ok(())
    }
}

/// R-hat of one parameter from runs of equal length (Gelman et al., equation 11.4).
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

/// Effective sample size of one parameter in chains of equal length (Gelman et al., equation 11.8).
pub fn effective_sample_size(chains: &[Vec<f64>]) -> f64 {
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
        // Geyer's initial monotone sequence: pair sums are positive and decreasing; the rest is noise.
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

/// Splits every chain into halves, so that a drifting chain disagrees with itself.
pub fn split_chains(chains: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let halves = |c: &Vec<f64>| [c[..c.len() / 2].to_vec(), c[c.len() - c.len() / 2..].to_vec()];
    chains.iter().flat_map(halves).collect()
}

/// Values of one parameter, grouped by run.
pub fn group_by_run(points: &[ParameterVector], run: &[usize], number: usize) -> Vec<Vec<f64>> {
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

    /// An AR(1) chain with correlation r has an efficiency of (1 - r) / (1 + r).
    #[test]
    fn effective_sample_size_matches_ar1_theory() {
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
            let found = effective_sample_size(&chains);
            assert!((found / wanted - 1.0).abs() < 0.2, "{r}: {found} for {wanted}");
            assert!(r_hat(&split_chains(&chains)) < 1.03);
        }
    }

    #[test]
    fn r_hat_detects_disagreement_and_drift() {
        let chains = [vec![0.0, 0.1, 0.0, 0.1], vec![1.0, 1.1, 1.0, 1.1]];
        assert!(r_hat(&chains) > 5.0);
        assert_eq!(r_hat(&[vec![1.0; 5], vec![1.0; 5]]), 1.0);
        assert_eq!(r_hat(&[vec![1.0; 5], vec![2.0; 5]]), f64::INFINITY);
        let drift = [(0..100).map(f64::from).collect::<Vec<_>>()];
        assert!(r_hat(&split_chains(&drift)) > 1.5);
    }

    #[test]
    fn verdict_fails_without_convergence() {
        let quality = |r: f64, n: f64| SamplingDiagnostics {
            r_hat: vec![1.0, r],
            effective: vec![900.0, n],
            accepted: 0.3,
        };
        assert!(quality(1.005, 500.0).verdict().is_ok());
        assert!(quality(1.2, 500.0).verdict().unwrap_err().contains("do not agree"));
        assert!(quality(1.0, 50.0).verdict().unwrap_err().contains("effective sample size is 50"));
        assert!(quality(f64::NAN, 500.0).verdict().is_err());
    }
}
