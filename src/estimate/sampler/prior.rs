//! What is believed of the numbers of a point before anything was measured: independent, each within bounds.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::log_sum_exp;
use crate::error::{Error, Result, within};
use crate::rng::Stream;
use crate::world::Sample;

/// What is believed of one number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Marginal {
    /// Normal, cut off at bounds.
    Normal { mean: f64, sd: f64, low: f64, high: f64 },
    /// Normal with one of several standard deviations, each as likely as the others, cut off at bounds: most such numbers are small, and some
    /// are not.
    Scales { mean: f64, sds: [f64; 4], low: f64, high: f64 },
    /// Anything between bounds.
    Uniform { low: f64, high: f64 },
}

/// What is believed of a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    marginals: Vec<Marginal>,
    /// Logarithm of what a normal density has within its bounds.
    inside: Vec<f64>,
}

/// Halvings by which a quantile is found: to the last bit.
const HALVINGS: usize = 200;

impl Prior {
    /// Errors name the number, by its place, whose belief is none.
    pub fn new(marginals: Vec<Marginal>) -> Result<Prior> {
        for (i, marginal) in marginals.iter().enumerate() {
            let [low, high] = marginal.bounds();
            within(&format!("prior[{i}].low"), low, -1e9, 1e9)?;
            within(&format!("prior[{i}].high"), high, low, 1e9)?;
            if low == high {
                return Err(Error::input(format!("prior[{i}].high"), high, format!("more than low, {low}")));
            }
            if let Some(mean) = marginal.mean() {
                within(&format!("prior[{i}].mean"), mean, -1e9, 1e9)?;
            }
            for sd in marginal.sds() {
                within(&format!("prior[{i}].sd"), *sd, 1e-12, 1e9)?;
            }
        }
        let inside = |m: &Marginal| libm::log(m.mass().max(f64::MIN_POSITIVE));
        Ok(Prior { inside: marginals.iter().map(inside).collect(), marginals })
    }

    /// By number.
    pub fn marginals(&self) -> &[Marginal] {
        &self.marginals
    }

    /// Log density; minus infinity outside of the bounds.
    pub fn log_density(&self, point: &[f64]) -> f64 {
        point.iter().enumerate().take(self.marginals.len()).map(|(i, x)| self.log_density_of(i, *x)).sum()
    }

    /// Log density of one number.
    pub fn log_density_of(&self, number: usize, x: f64) -> f64 {
        self.marginals[number].log_density(x) - self.inside[number]
    }

    /// Whether a point lies within the bounds.
    pub fn allows(&self, point: &[f64]) -> bool {
        let within = |(m, x): (&Marginal, &f64)| (m.bounds()[0]..=m.bounds()[1]).contains(x);
        point.len() == self.marginals.len() && self.marginals.iter().zip(point).all(within)
    }

    /// A point drawn from it.
    pub fn draw(&self, stream: &mut Stream) -> Sample {
        self.marginals.iter().map(|m| m.quantile(stream.random())).collect()
    }
}

impl Marginal {
    /// Least and greatest value.
    pub fn bounds(&self) -> [f64; 2] {
        match *self {
            Marginal::Normal { low, high, .. }
            | Marginal::Scales { low, high, .. }
            | Marginal::Uniform { low, high } => [low, high],
        }
    }

    /// Mean of what is not cut off; none of what is uniform.
    fn mean(&self) -> Option<f64> {
        match *self {
            Marginal::Normal { mean, .. } | Marginal::Scales { mean, .. } => Some(mean),
            Marginal::Uniform { .. } => None,
        }
    }

    /// Standard deviations of normal densities, each as likely as the others.
    fn sds(&self) -> &[f64] {
        match self {
            Marginal::Normal { sd, .. } => std::slice::from_ref(sd),
            Marginal::Scales { sds, .. } => sds,
            Marginal::Uniform { .. } => &[],
        }
    }

    /// Share of uncut normal densities below a value.
    fn below(&self, x: f64) -> f64 {
        let mean = self.mean().unwrap_or(0.0);
        self.sds().iter().map(|sd| normal((x - mean) / sd)).sum::<f64>() / self.sds().len() as f64
    }

    /// Middle and width: mean and standard deviation of what is not cut off.
    pub fn centre(&self) -> [f64; 2] {
        match *self {
            Marginal::Normal { mean, sd, low, high } => [mean.clamp(low, high), sd],
            Marginal::Scales { mean, sds, low, high } => {
                let square = sds.iter().map(|sd| sd * sd).sum::<f64>() / sds.len() as f64;
                [mean.clamp(low, high), square.sqrt()]
            }
            Marginal::Uniform { low, high } => [0.5 * (low + high), (high - low) / 12f64.sqrt()],
        }
    }

    /// The value below which so much of it lies.
    pub fn quantile(&self, share: f64) -> f64 {
        match *self {
            Marginal::Uniform { low, high } => low + share * (high - low),
            Marginal::Normal { low, high, .. } | Marginal::Scales { low, high, .. } => {
                let below = |x: f64| self.below(x);
                let wanted = below(low) + share * (below(high) - below(low));
                let (mut a, mut b) = (low, high);
                for _ in 0..HALVINGS {
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

    /// Share of uncut normal densities within the bounds; the width of what is uniform.
    fn mass(&self) -> f64 {
        match *self {
            Marginal::Uniform { low, high } => high - low,
            Marginal::Normal { low, high, .. } | Marginal::Scales { low, high, .. } => {
                self.below(high) - self.below(low)
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
            Marginal::Normal { mean, sd, .. } => log_normal(x - mean, sd),
            Marginal::Scales { mean, sds, .. } => {
                log_sum_exp(sds.map(|sd| log_normal(x - mean, sd))) - libm::log(sds.len() as f64)
            }
        }
    }
}

/// Log density of a normal distribution about nothing.
fn log_normal(x: f64, sd: f64) -> f64 {
    let z = x / sd;
    -0.5 * z * z - libm::log(sd) - 0.5 * libm::log(2.0 * std::f64::consts::PI)
}

/// Share of the standard normal distribution below `z`.
fn normal(z: f64) -> f64 {
    0.5 * libm::erfc(-z / std::f64::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng;

    fn both() -> Prior {
        let normal = Marginal::Normal { mean: 0.5, sd: 0.25, low: 0.0, high: 1.0 };
        Prior::new(vec![normal, Marginal::Uniform { low: -2.0, high: 3.0 }]).unwrap()
    }

    #[test]
    fn densities_are_whole() {
        let prior = both();
        let n = 2000;
        let at = |i: usize| (i as f64 + 0.5) / n as f64;
        let sum: f64 = (0..n).map(|i| prior.log_density(&[at(i), 0.3]).exp()).sum::<f64>() / n as f64;
        assert!((sum - 0.2).abs() < 1e-6, "a fifth of what is uniform over 5: {sum}");
        assert_eq!(prior.log_density(&[1.2, 0.0]), f64::NEG_INFINITY);
        assert!(prior.allows(&[1.0, -2.0]) && !prior.allows(&[0.5, 3.1]) && !prior.allows(&[0.5]));
    }

    /// Of what may be of several sizes the density is whole, draws are as it says, and what is far off is far likelier than for one size.
    #[test]
    fn what_may_be_of_several_sizes() {
        let scales = Marginal::Scales { mean: 0.1, sds: [0.1, 0.3, 1.0, 3.0], low: -9.0, high: 9.0 };
        let prior = Prior::new(vec![scales]).unwrap();
        let n = 36_000;
        let at = |i: usize| -9.0 + 18.0 * (i as f64 + 0.5) / n as f64;
        let sum: f64 = (0..n).map(|i| prior.log_density(&[at(i)]).exp()).sum::<f64>() * 18.0 / n as f64;
        assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        let share = (0..n).filter(|i| at(*i) < 0.4).map(|i| prior.log_density(&[at(i)]).exp()).sum::<f64>();
        let share = share * 18.0 / n as f64;
        assert!((scales.quantile(share) - 0.4).abs() < 1e-3);
        let one = Prior::new(vec![Marginal::Normal { mean: 0.1, sd: 0.3, low: -9.0, high: 9.0 }]).unwrap();
        assert!(prior.log_density(&[5.0]) > one.log_density(&[5.0]) + 100.0);
        assert!(
            Prior::new(vec![Marginal::Scales { mean: 0.0, sds: [0.1, 0.0, 1.0, 3.0], low: -1.0, high: 1.0 }])
                .is_err()
        );
    }

    #[test]
    fn draws_are_as_believed() {
        let prior = both();
        let mut stream = rng::stream(4, "prior");
        let drawn: Vec<Sample> = (0..4000).map(|_| prior.draw(&mut stream)).collect();
        assert!(drawn.iter().all(|p| prior.allows(p)));
        let mean = |k: usize| drawn.iter().map(|p| p[k]).sum::<f64>() / 4000.0;
        assert!((mean(0) - 0.5).abs() < 0.02 && (mean(1) - 0.5).abs() < 0.1, "{} {}", mean(0), mean(1));
        let below = drawn.iter().filter(|p| p[0] < 0.25).count() as f64 / 4000.0;
        let wanted = (normal(-1.0) - normal(-2.0)) / (normal(2.0) - normal(-2.0));
        assert!((below - wanted).abs() < 0.02, "{below} for {wanted}");
    }

    #[test]
    fn what_is_no_belief_is_refused() {
        let refused = |m: Marginal, name: &str| {
            let error = Prior::new(vec![m]).unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        refused(Marginal::Uniform { low: 1.0, high: 1.0 }, "prior[0].high");
        refused(Marginal::Uniform { low: f64::NAN, high: 1.0 }, "prior[0].low");
        refused(Marginal::Normal { mean: 0.0, sd: 0.0, low: -1.0, high: 1.0 }, "prior[0].sd");
    }
}
