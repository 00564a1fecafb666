//! Independent, bounded prior distributions of the parameters.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::log_sum_exp;
use crate::error::{Error, Result, check_range};
use crate::rng::Stream;
use crate::world::ParameterVector;

/// Prior of one parameter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Marginal {
    /// Truncated normal.
    Normal { mean: f64, sd: f64, low: f64, high: f64 },
    /// Truncated scale mixture of normals with equal weights: a heavy-tailed shrinkage prior.
    Scales { mean: f64, sds: [f64; 4], low: f64, high: f64 },
    /// Uniform.
    Uniform { low: f64, high: f64 },
}

/// Joint prior of a parameter vector.
#[derive(Clone, Debug, PartialEq)]
pub struct JointPrior {
    marginals: Vec<Marginal>,
    /// Log normalisation within the bounds.
    log_mass: Vec<f64>,
}

/// Maximum number of bisections for a quantile; enough for the last bit.
const MAX_BISECTIONS: usize = 200;

impl JointPrior {
    /// Errors name the index of the invalid prior.
    pub fn new(marginals: Vec<Marginal>) -> Result<JointPrior> {
        for (i, marginal) in marginals.iter().enumerate() {
            let [low, high] = marginal.bounds();
            check_range(&format!("prior[{i}].low"), low, -1e9, 1e9)?;
            check_range(&format!("prior[{i}].high"), high, low, 1e9)?;
            if low == high {
                return Err(Error::input(format!("prior[{i}].high"), high, format!("more than low, {low}")));
            }
            if let Some(mean) = marginal.mean() {
                check_range(&format!("prior[{i}].mean"), mean, -1e9, 1e9)?;
            }
            for sd in marginal.sds() {
                check_range(&format!("prior[{i}].sd"), *sd, 1e-12, 1e9)?;
            }
        }
        let inside = |m: &Marginal| libm::log(m.untruncated_mass().max(f64::MIN_POSITIVE));
        Ok(JointPrior { log_mass: marginals.iter().map(inside).collect(), marginals })
    }

    /// Marginal priors in parameter order.
    pub fn marginals(&self) -> &[Marginal] {
        &self.marginals
    }

    /// Log density; minus infinity outside the bounds.
    pub fn log_density(&self, point: &[f64]) -> f64 {
        point
            .iter()
            .enumerate()
            .take(self.marginals.len())
            .map(|(i, x)| self.marginal_log_density(i, *x))
            .sum()
    }

    /// Log density of one parameter.
    pub fn marginal_log_density(&self, number: usize, x: f64) -> f64 {
        self.marginals[number].log_density(x) - self.log_mass[number]
    }

    /// Whether a point is within the bounds.
    pub fn contains(&self, point: &[f64]) -> bool {
        let within = |(m, x): (&Marginal, &f64)| (m.bounds()[0]..=m.bounds()[1]).contains(x);
        point.len() == self.marginals.len() && self.marginals.iter().zip(point).all(within)
    }

    /// Draws a point.
    pub fn draw(&self, stream: &mut Stream) -> ParameterVector {
        self.marginals.iter().map(|m| m.quantile(stream.random())).collect()
    }
}

impl Marginal {
    /// Lower and upper bound.
    pub fn bounds(&self) -> [f64; 2] {
        match *self {
            Marginal::Normal { low, high, .. }
            | Marginal::Scales { low, high, .. }
            | Marginal::Uniform { low, high } => [low, high],
        }
    }

    /// Mean before truncation; `None` for a uniform.
    fn mean(&self) -> Option<f64> {
        match *self {
            Marginal::Normal { mean, .. } | Marginal::Scales { mean, .. } => Some(mean),
            Marginal::Uniform { .. } => None,
        }
    }

    /// Standard deviations of the mixture's components.
    fn sds(&self) -> &[f64] {
        match self {
            Marginal::Normal { sd, .. } => std::slice::from_ref(sd),
            Marginal::Scales { sds, .. } => sds,
            Marginal::Uniform { .. } => &[],
        }
    }

    /// Cumulative distribution before truncation.
    fn cdf(&self, x: f64) -> f64 {
        let mean = self.mean().unwrap_or(0.0);
        self.sds().iter().map(|sd| normal_cdf((x - mean) / sd)).sum::<f64>() / self.sds().len() as f64
    }

    /// Mean (clamped to the bounds) and standard deviation before truncation.
    pub fn centre_and_sd(&self) -> [f64; 2] {
        match *self {
            Marginal::Normal { mean, sd, low, high } => [mean.clamp(low, high), sd],
            Marginal::Scales { mean, sds, low, high } => {
                let square = sds.iter().map(|sd| sd * sd).sum::<f64>() / sds.len() as f64;
                [mean.clamp(low, high), square.sqrt()]
            }
            Marginal::Uniform { low, high } => [0.5 * (low + high), (high - low) / 12f64.sqrt()],
        }
    }

    /// Quantile function.
    pub fn quantile(&self, share: f64) -> f64 {
        match *self {
            Marginal::Uniform { low, high } => low + share * (high - low),
            Marginal::Normal { low, high, .. } | Marginal::Scales { low, high, .. } => {
                let below = |x: f64| self.cdf(x);
                let wanted = below(low) + share * (below(high) - below(low));
                let (mut a, mut b) = (low, high);
                for _ in 0..MAX_BISECTIONS {
                    let middle = 0.5 * (a + b);
                    if middle <= a || middle >= b {
                        break;
                    }
                    if below(middle) < wanted { a = middle } else { b = middle }
                }
                0.5 * (a + b)
            }
        }
    }

    /// Probability within the bounds before truncation; the width of a uniform.
    fn untruncated_mass(&self) -> f64 {
        match *self {
            Marginal::Uniform { low, high } => high - low,
            Marginal::Normal { low, high, .. } | Marginal::Scales { low, high, .. } => {
                self.cdf(high) - self.cdf(low)
            }
        }
    }

    fn log_density(&self, x: f64) -> f64 {
        let [low, high] = self.bounds();
        if !(low..=high).contains(&x) {
            return f64::NEG_INFINITY;
        }
        match *self {
            Marginal::Uniform { .. } => 0.0,
            Marginal::Normal { mean, sd, .. } => normal_log_density(x - mean, sd),
            Marginal::Scales { mean, sds, .. } => {
                log_sum_exp(sds.map(|sd| normal_log_density(x - mean, sd))) - libm::log(sds.len() as f64)
            }
        }
    }
}

/// Log density of a zero-mean normal.
fn normal_log_density(x: f64, sd: f64) -> f64 {
    let z = x / sd;
    -0.5 * z * z - libm::log(sd) - 0.5 * libm::log(2.0 * std::f64::consts::PI)
}

/// Standard normal cumulative distribution.
fn normal_cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z / std::f64::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng;

    fn two_marginals() -> JointPrior {
        let normal = Marginal::Normal { mean: 0.5, sd: 0.25, low: 0.0, high: 1.0 };
        JointPrior::new(vec![normal, Marginal::Uniform { low: -2.0, high: 3.0 }]).unwrap()
    }

    #[test]
    fn density_integrates_to_one() {
        let prior = two_marginals();
        let n = 2000;
        let at = |i: usize| (i as f64 + 0.5) / n as f64;
        let sum: f64 = (0..n).map(|i| prior.log_density(&[at(i), 0.3]).exp()).sum::<f64>() / n as f64;
        assert!((sum - 0.2).abs() < 1e-6, "density of a uniform over 5: {sum}");
        assert_eq!(prior.log_density(&[1.2, 0.0]), f64::NEG_INFINITY);
        assert!(prior.contains(&[1.0, -2.0]) && !prior.contains(&[0.5, 3.1]) && !prior.contains(&[0.5]));
    }

    /// A scale mixture integrates to 1, its quantiles match its density, and its tails are heavier than a
    /// normal's.
    #[test]
    fn scale_mixture_is_normalised_and_heavy_tailed() {
        let scales = Marginal::Scales { mean: 0.1, sds: [0.1, 0.3, 1.0, 3.0], low: -9.0, high: 9.0 };
        let prior = JointPrior::new(vec![scales]).unwrap();
        let n = 36_000;
        let at = |i: usize| -9.0 + 18.0 * (i as f64 + 0.5) / n as f64;
        let sum: f64 = (0..n).map(|i| prior.log_density(&[at(i)]).exp()).sum::<f64>() * 18.0 / n as f64;
        assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        let share = (0..n).filter(|i| at(*i) < 0.4).map(|i| prior.log_density(&[at(i)]).exp()).sum::<f64>();
        let share = share * 18.0 / n as f64;
        assert!((scales.quantile(share) - 0.4).abs() < 1e-3);
        let one =
            JointPrior::new(vec![Marginal::Normal { mean: 0.1, sd: 0.3, low: -9.0, high: 9.0 }]).unwrap();
        assert!(prior.log_density(&[5.0]) > one.log_density(&[5.0]) + 100.0);
        assert!(
            JointPrior::new(vec![Marginal::Scales {
                mean: 0.0,
                sds: [0.1, 0.0, 1.0, 3.0],
                low: -1.0,
                high: 1.0
            }])
            .is_err()
        );
    }

    #[test]
    fn draws_match_the_prior() {
        let prior = two_marginals();
        let mut stream = rng::stream(4, "prior");
        let drawn: Vec<ParameterVector> = (0..4000).map(|_| prior.draw(&mut stream)).collect();
        assert!(drawn.iter().all(|p| prior.contains(p)));
        let mean = |k: usize| drawn.iter().map(|p| p[k]).sum::<f64>() / 4000.0;
        assert!((mean(0) - 0.5).abs() < 0.02 && (mean(1) - 0.5).abs() < 0.1, "{} {}", mean(0), mean(1));
        let below = drawn.iter().filter(|p| p[0] < 0.25).count() as f64 / 4000.0;
        let wanted = (normal_cdf(-1.0) - normal_cdf(-2.0)) / (normal_cdf(2.0) - normal_cdf(-2.0));
        assert!((below - wanted).abs() < 0.02, "{below} for {wanted}");
    }

    #[test]
    fn rejects_invalid_priors() {
        let refused = |m: Marginal, name: &str| {
            let error = JointPrior::new(vec![m]).unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        refused(Marginal::Uniform { low: 1.0, high: 1.0 }, "prior[0].high");
        refused(Marginal::Uniform { low: f64::NAN, high: 1.0 }, "prior[0].low");
        refused(Marginal::Normal { mean: 0.0, sd: 0.0, low: -1.0, high: 1.0 }, "prior[0].sd");
    }
}
