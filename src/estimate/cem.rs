//! The cross-entropy method over a multivariate normal distribution of latents.
//!
//! Source: Semage et al., algorithm 1 and its experimental settings (1000 samples a round, 200 elites);
//! Rubinstein and Kroese 2004.
//!
//! Differences from the source:
//! - Samples outside a factor's bounds are clamped; samples outside narrower limits are redrawn.
//! - The preset `fast` smooths mean and covariance, because the plain method converges prematurely when
//!   parameters are correlated. It runs several iterations per round of measurements.
//! - The covariance has a floor, so that later rounds with other trials can still move the estimate.

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, check_range};
use crate::rng::Stream;
use crate::world::LINEAR_DRAG;
use crate::world::latent::FACTORS;
use crate::world::{EffectParameter, ParameterSpace, ParameterVector};

/// Parameters of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CemConfig {
    /// Samples per iteration.
    pub samples: usize,
    /// Number of best samples that the next distribution is fitted to.
    pub elites: usize,
    /// Iterations per round of measurements.
    pub iterations: usize,
    /// Weight of the previous mean and covariance, in [0, 1).
    pub smoothing: f64,
    /// Prior mean and standard deviation of density, friction and restitution.
    pub prior: [(f64, f64); 3],
    /// Prior mean and standard deviation of the linear drag coefficient, 1/s, if it is estimated; `None`
    /// simulates without drag.
    #[serde(default)]
    pub drag: Option<(f64, f64)>,
    /// Other effect parameters to estimate.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fit: Vec<FreeParameter>,
    /// Minimum standard deviation as a share of the prior's.
    pub floor: f64,
    /// Search limits of density, friction and restitution; `None` uses the factors' bounds. Samples outside are
    /// redrawn up to [`MAX_REDRAWS`] times, then clamped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<[[f64; 2]; 3]>,
}

/// An effect parameter that is estimated together with the latents.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FreeParameter {
    /// The parameter, for example `quadratic_drag.k`.
    pub parameter: EffectParameter,
    /// Mean of the initial distribution.
    pub mean: f64,
    pub sd: f64,
}

/// Maximum number of redraws of a sample outside the limits. If half of the distribution is outside, all but
/// one in 10^9 samples succeed.
const MAX_REDRAWS: usize = 30;

/// State of a search as plain data; [`Cem::resume`] continues from it bit for bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CemState {
    /// Mean of every coordinate.
    pub mean: ParameterVector,
    /// Covariance, by rows.
    pub covariance: Vec<ParameterVector>,
}

/// A cross-entropy search.
#[derive(Clone, Debug)]
pub struct Cem {
    config: CemConfig,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl CemConfig {
    /// The paper's settings: one iteration of 1000 samples and 200 elites a round, no smoothing.
    pub fn paper(prior: [(f64, f64); 3]) -> CemConfig {
        CemConfig {
            samples: 1000,
            elites: 200,
            iterations: 1,
            smoothing: 0.0,
            prior,
            drag: None,
            fit: Vec::new(),
            floor: 0.0,
            limits: None,
        }
    }

    /// Fewer simulations for the same accuracy: small smoothed iterations, several a round.
    pub fn fast(prior: [(f64, f64); 3]) -> CemConfig {
        CemConfig {
            samples: 160,
            elites: 24,
            iterations: 4,
            smoothing: 0.3,
            floor: 0.02,
            ..CemConfig::paper(prior)
        }
    }

    /// Adds a parameter to estimate, with its weak default prior.
    pub fn add_free_parameter(&mut self, parameter: EffectParameter) {
        let (mean, sd) = parameter.parameter().weak_prior();
        if parameter == LINEAR_DRAG {
            self.drag = Some((mean, sd));
        } else {
            self.fit.push(FreeParameter { parameter, mean, sd });
        }
    }

    /// Effect parameters that are estimated.
    pub fn free_parameters(&self) -> Vec<EffectParameter> {
        self.drag.map(|_| LINEAR_DRAG).into_iter().chain(self.fit.iter().map(|a| a.parameter)).collect()
    }

    /// Names of the effects with an estimated parameter, each once.
    pub fn free_effects(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for name in self.free_parameters().iter().map(|own| own.effect.name) {
            if !names.iter().any(|known| known == name) {
                names.push(name.to_string());
            }
        }
        names
    }

    /// The coordinates of a sample.
    pub fn coordinates(&self) -> ParameterSpace {
        ParameterSpace::new(&self.free_parameters())
    }

    /// Initial mean and standard deviation of every coordinate; (0, 0) for a fixed coordinate.
    pub fn start(&self) -> Vec<(f64, f64)> {
        let drag = self.drag.unwrap_or((0.0, 0.0));
        self.prior.into_iter().chain([drag]).chain(self.fit.iter().map(|a| (a.mean, a.sd))).collect()
    }

    /// Initial standard deviations; 0 for a fixed coordinate.
    pub fn prior_sd(&self) -> ParameterVector {
        self.start().iter().map(|p| p.1).collect()
    }

    /// Lower and upper limit of every coordinate.
    pub fn limits(&self) -> Vec<[f64; 2]> {
        let factors = self.limits.unwrap_or(FACTORS.map(|f| f.bounds));
        let all = self.coordinates();
        (0..all.len()).map(|i| factors.get(i).copied().unwrap_or_else(|| all.bounds(i))).collect()
    }

    /// Errors name the parameter that is out of range.
    pub fn validate(&self) -> Result<()> {
        check_range("samples", self.samples as f64, 4.0, 100_000.0)?;
        if !(2..=self.samples).contains(&self.elites) {
            let allowed = format!("2 to the number of samples, {}", self.samples);
            return Err(Error::input("elites", self.elites, allowed));
        }
        check_range("iterations", self.iterations as f64, 1.0, 1000.0)?;
        check_range("smoothing", self.smoothing, 0.0, 0.99)?;
        check_range("floor", self.floor, 0.0, 1.0)?;
        for (i, limits) in self.limits.iter().flatten().enumerate() {
            let [low, high] = FACTORS[i].bounds;
            check_range(&format!("limits[{i}][0]"), limits[0], low, high)?;
            check_range(&format!("limits[{i}][1]"), limits[1], limits[0], high)?;
        }
        if let Some((mean, sd)) = self.drag {
            check_range("drag[0]", mean, 0.0, 100.0)?;
            check_range("drag[1]", sd, 1e-9, 100.0)?;
        }
        for (i, along) in self.fit.iter().enumerate() {
            let name = along.parameter;
            if name == LINEAR_DRAG || self.fit[..i].iter().any(|other| other.parameter == name) {
                let allowed = format!("each parameter once, and {LINEAR_DRAG} as `drag`");
                return Err(Error::input(format!("fit[{i}].parameter"), name, allowed));
            }
            let [low, high] = name.parameter().bounds;
            check_range(&format!("fit[{i}].mean"), along.mean, low, high)?;
            check_range(&format!("fit[{i}].sd"), along.sd, 1e-9, high - low)?;
        }
        for (i, (mean, sd)) in self.prior.iter().enumerate() {
            check_range(&format!("prior[{i}][0]"), *mean, -1e6, 1e6)?;
            check_range(&format!("prior[{i}][1]"), *sd, 1e-9, 1e6)?;
        }
        Ok(())
    }
}

impl Cem {
    /// Starts a search from the configured prior.
    pub fn new(config: CemConfig) -> Result<Cem> {
        config.validate()?;
        let (start, limits) = (config.start(), config.limits());
        let mean = DVector::from_fn(start.len(), |i, _| match config.limits {
            Some(_) => start[i].0.clamp(limits[i][0], limits[i][1]),
            None => start[i].0,
        });
        let covariance = DMatrix::from_diagonal(&DVector::from_fn(start.len(), |i, _| start[i].1.powi(2)));
        Ok(Cem { config, mean, covariance })
    }

    /// Resumes a search from `state`.
    pub fn resume(config: CemConfig, state: &CemState) -> Result<Cem> {
        config.validate()?;
        let (n, found) = (config.start().len(), state.mean.len());
        let square = state.covariance.len() == n && state.covariance.iter().all(|row| row.len() == n);
        if found != n || !square {
            let allowed = format!("{n} coordinates, those of the configuration");
            return Err(Error::input("search", format!("{found} coordinates"), allowed));
        }
        let covariance = DMatrix::from_fn(n, n, |i, j| state.covariance[i][j]);
        Ok(Cem { config, mean: DVector::from_column_slice(&state.mean), covariance })
    }

    /// The current state.
    pub fn state(&self) -> CemState {
        let covariance = self.covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
        CemState { mean: self.mean.as_slice().to_vec(), covariance }
    }

    /// Draws the next iteration's samples, each within bounds.
    pub fn ask(&self, stream: &mut Stream) -> Vec<ParameterVector> {
        let root = self.cholesky_factor();
        (0..self.config.samples)
            .map(|_| {
                let mut draw = || -> DVector<f64> {
                    let z = DVector::from_fn(self.mean.len(), |_, _| StandardNormal.sample(stream));
                    &self.mean + &root * z
                };
                let mut x = draw();
                for _ in 0..MAX_REDRAWS {
                    if self.is_within_limits(&x) {
                        break;
                    }
                    x = draw();
                }
                self.clamp(&x)
            })
            .collect()
    }

    /// Fits the distribution to the samples with the lowest losses; ties keep the order of samples.
    pub fn tell(&mut self, samples: &[ParameterVector], losses: &[f64]) {
        let mut order: Vec<usize> = (0..samples.len()).collect();
        order.sort_by(|a, b| losses[*a].total_cmp(&losses[*b]));
        order.truncate(self.config.elites);
        let n = order.len() as f64;
        let size = self.mean.len();
        let elites = || order.iter().map(|i| DVector::from_column_slice(&samples[*i]));
        let mean = elites().fold(DVector::zeros(size), |sum, x| sum + x) / n;
        let scatter = elites().fold(DMatrix::zeros(size, size), |sum, x| {
            let off = x - &mean;
            sum + &off * off.transpose()
        });
        let keep = self.config.smoothing;
        self.mean = &self.mean * keep + mean * (1.0 - keep);
        self.covariance = &self.covariance * keep + scatter / n * (1.0 - keep);
        for (i, start) in self.config.start().iter().enumerate() {
            let floor = (self.config.floor * start.1).powi(2);
            self.covariance[(i, i)] = self.covariance[(i, i)].max(floor);
        }
    }

    /// The current estimate, within bounds.
    pub fn estimate(&self) -> ParameterVector {
        self.clamp(&self.mean)
    }

    /// The current standard deviations.
    pub fn standard_deviations(&self) -> ParameterVector {
        self.covariance.diagonal().iter().map(|v| v.max(0.0).sqrt()).collect()
    }

    /// Number of elites.
    pub fn elites(&self) -> usize {
        self.config.elites
    }

    /// Whether a sample is within the configured limits.
    fn is_within_limits(&self, x: &DVector<f64>) -> bool {
        let limits = self.config.limits.iter().flatten().enumerate();
        limits.into_iter().all(|(i, [low, high])| (*low..=*high).contains(&x[i]))
    }

    fn clamp(&self, x: &DVector<f64>) -> ParameterVector {
        // Fixed coordinates are 0: the jitter that keeps the covariance definite does not apply to them.
        let bounded = |((value, (_, sd)), [low, high]): ((&f64, (f64, f64)), [f64; 2])| {
            if sd > 0.0 { value.clamp(low, high) } else { 0.0 }
        };
        x.iter().zip(self.config.start()).zip(self.config.limits()).map(bounded).collect()
    }

    /// Cholesky factor of the covariance; diagonal if rounding made the covariance indefinite.
    fn cholesky_factor(&self) -> DMatrix<f64> {
        let start = self.config.start();
        let jitter = DVector::from_fn(start.len(), |i, _| 1e-18 + 1e-12 * start[i].1.powi(2));
        match (&self.covariance + DMatrix::from_diagonal(&jitter)).cholesky() {
            Some(cholesky) => cholesky.l(),
            None => DMatrix::from_diagonal(&DVector::from_vec(self.standard_deviations())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng;

    fn search(config: CemConfig, loss: impl Fn(&ParameterVector) -> f64, iterations: usize) -> Cem {
        let mut cem = Cem::new(config).unwrap();
        let mut stream = rng::stream(5, "cem");
        for _ in 0..iterations {
            let samples = cem.ask(&mut stream);
            let losses: Vec<f64> = samples.iter().map(&loss).collect();
            cem.tell(&samples, &losses);
        }
        cem
    }

    const PRIOR: [(f64, f64); 3] = [(1.0, 0.5), (1.0, 0.5), (0.5, 0.25)];

    #[test]
    fn converges_to_the_minimum_of_a_quadratic() {
        let truth = [0.6, 0.4, 0.8];
        let loss = |x: &ParameterVector| {
            let d: [f64; 3] = std::array::from_fn(|i| x[i] - truth[i]);
            d[0] * d[0] + d[1] * d[1] + 4.0 * d[2] * d[2] + 1.5 * d[0] * d[1]
        };
        for (config, iterations) in [(CemConfig::paper(PRIOR), 10), (CemConfig::fast(PRIOR), 24)] {
            let found = search(config, loss, iterations).estimate();
            for i in 0..3 {
                assert!((found[i] - truth[i]).abs() < 0.02 * 2.0, "{found:?}");
            }
        }
    }

    #[test]
    fn unidentified_direction_keeps_its_width() {
        // The loss does not depend on density: its standard deviation must not collapse like that of
        // restitution.
        let loss = |x: &ParameterVector| (x[1] - 0.5).powi(2) + (x[2] - 0.5).powi(2);
        let found = search(CemConfig::fast(PRIOR), loss, 12);
        assert!(
            found.standard_deviations()[0] > 10.0 * found.standard_deviations()[2],
            "{:?}",
            found.standard_deviations()
        );
    }

    #[test]
    fn samples_stay_in_bounds() {
        let prior = [(0.01, 5.0), (0.01, 5.0), (0.99, 5.0)];
        let cem = Cem::new(CemConfig::fast(prior)).unwrap();
        for s in cem.ask(&mut rng::stream(1, "cem")) {
            crate::world::Latents::of([s[0], s[1], s[2]]).validate().unwrap();
        }
    }
}
