//! The cross-entropy method over a multivariate normal distribution of latents.
//!
//! Source: Semage et al., algorithm 1 and its experimental settings (1000 samples a round, 200 elites);
//! Rubinstein and Kroese 2004.
//!
//! Differences from the source:
//! - Samples outside a factor's bounds are moved to the bound; outside narrower limits they are drawn again.
//! - The preset `fast` smooths mean and covariance (keeps part of the old), because the plain method collapses
//!   too soon when parameters trade off, and takes several iterations for each round of measurements.
//! - The covariance keeps a floor, so that a later round with other trials can still move the estimate.

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, within};
use crate::rng::Stream;
use crate::world::DRAG;
use crate::world::latent::FACTORS;
use crate::world::{Coordinates, EffectParameter, Sample};

/// Knobs of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CemConfig {
    /// Latent samples per iteration.
    pub samples: usize,
    /// How many of the best samples the next distribution is fitted to.
    pub elites: usize,
    /// Iterations for each round of measurements.
    pub iterations: usize,
    /// Share of the old mean and covariance that is kept, [0, 1).
    pub smoothing: f64,
    /// Mean and standard deviation of density, friction and restitution to start from.
    pub prior: [(f64, f64); 3],
    /// Mean and standard deviation of the coefficient of linear drag (1/s) where it is fitted along; `None` leaves
    /// the simulation without.
    #[serde(default)]
    pub drag: Option<(f64, f64)>,
    /// Other parameters of effects that are fitted along.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fit: Vec<Along>,
    /// Standard deviations never shrink below this share of the prior's.
    pub floor: f64,
    /// Least and greatest density, friction and restitution to be considered; `None` leaves the factors' bounds.
    /// Samples beyond are drawn again, up to [`REDRAWN`] times, then moved to the limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<[[f64; 2]; 3]>,
}

/// A parameter of an effect that is fitted along with the latents.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Along {
    /// `quadratic_drag.k`, say.
    pub parameter: EffectParameter,
    /// Where the search for it starts, and how wide.
    pub mean: f64,
    pub sd: f64,
}

/// Most times a sample beyond a limit is drawn again. With half of the distribution beyond, all but one in 10^9 get in.
const REDRAWN: usize = 30;

/// Where a search stands, as plain data: [`Cem::at`] takes it up again to the bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Mean of every coordinate.
    pub mean: Sample,
    /// Covariance, by rows.
    pub covariance: Vec<Sample>,
}

/// The state of the search.
#[derive(Clone, Debug)]
pub struct Cem {
    config: CemConfig,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl CemConfig {
    /// As in the paper: one iteration of 1000 samples and 200 elites a round, no smoothing.
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
            prior,
            drag: None,
            fit: Vec::new(),
            floor: 0.02,
            limits: None,
        }
    }

    /// Fits a parameter along, from what is weakly believed of it.
    pub fn fit_along(&mut self, parameter: EffectParameter) {
        let (mean, sd) = parameter.parameter().prior();
        if parameter == DRAG {
            self.drag = Some((mean, sd));
        } else {
            self.fit.push(Along { parameter, mean, sd });
        }
    }

    /// The parameters that are fitted along.
    pub fn fitted(&self) -> Vec<EffectParameter> {
        self.drag.map(|_| DRAG).into_iter().chain(self.fit.iter().map(|a| a.parameter)).collect()
    }

    /// Names of the effects of which something is fitted along, each once.
    pub fn effects_fitted(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for name in self.fitted().iter().map(|own| own.effect.name) {
            if !names.iter().any(|known| known == name) {
                names.push(name.to_string());
            }
        }
        names
    }

    /// What the numbers of a sample are.
    pub fn coordinates(&self) -> Coordinates {
        Coordinates::new(&self.fitted())
    }

    /// Where the search starts: mean and standard deviation of every coordinate; (0, 0) for one that is held.
    pub fn start(&self) -> Vec<(f64, f64)> {
        let drag = self.drag.unwrap_or((0.0, 0.0));
        self.prior.into_iter().chain([drag]).chain(self.fit.iter().map(|a| (a.mean, a.sd))).collect()
    }

    /// Standard deviations of the start; 0 for what is held.
    pub fn deviations(&self) -> Sample {
        self.start().iter().map(|p| p.1).collect()
    }

    /// Least and greatest value of every coordinate.
    pub fn limits(&self) -> Vec<[f64; 2]> {
        let factors = self.limits.unwrap_or(FACTORS.map(|f| f.bounds));
        let all = self.coordinates();
        (0..all.len()).map(|i| factors.get(i).copied().unwrap_or_else(|| all.bounds(i))).collect()
    }

    /// Errors name the knob that is out of range.
    pub fn validate(&self) -> Result<()> {
        within("samples", self.samples as f64, 4.0, 100_000.0)?;
        if !(2..=self.samples).contains(&self.elites) {
            return Err(Error::input(
                "elites",
                self.elites,
                format!("2 to the number of samples, {}", self.samples),
            ));
        }
        within("iterations", self.iterations as f64, 1.0, 1000.0)?;
        within("smoothing", self.smoothing, 0.0, 0.99)?;
        within("floor", self.floor, 0.0, 1.0)?;
        for (i, limits) in self.limits.iter().flatten().enumerate() {
            let [low, high] = FACTORS[i].bounds;
            within(&format!("limits[{i}][0]"), limits[0], low, high)?;
            within(&format!("limits[{i}][1]"), limits[1], limits[0], high)?;
        }
        if let Some((mean, sd)) = self.drag {
            within("drag[0]", mean, 0.0, 100.0)?;
            within("drag[1]", sd, 1e-9, 100.0)?;
        }
        for (i, along) in self.fit.iter().enumerate() {
            let name = along.parameter;
            if name == DRAG || self.fit[..i].iter().any(|other| other.parameter == name) {
                let allowed = format!("each parameter once, and {DRAG} as `drag`");
                return Err(Error::input(format!("fit[{i}].parameter"), name, allowed));
            }
            let [low, high] = name.parameter().bounds;
            within(&format!("fit[{i}].mean"), along.mean, low, high)?;
            within(&format!("fit[{i}].sd"), along.sd, 1e-9, high - low)?;
        }
        for (i, (mean, sd)) in self.prior.iter().enumerate() {
            within(&format!("prior[{i}][0]"), *mean, -1e6, 1e6)?;
            within(&format!("prior[{i}][1]"), *sd, 1e-9, 1e6)?;
        }
        Ok(())
    }
}

impl Cem {
    /// A search that starts from the configured prior.
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

    /// The search as it stood at `state`.
    pub fn at(config: CemConfig, state: &State) -> Result<Cem> {
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

    /// Where the search stands.
    pub fn state(&self) -> State {
        let covariance = self.covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
        State { mean: self.mean.as_slice().to_vec(), covariance }
    }

    /// The next iteration's samples, each within bounds.
    pub fn ask(&self, stream: &mut Stream) -> Vec<Sample> {
        let root = self.root();
        (0..self.config.samples)
            .map(|_| {
                let mut draw = || -> DVector<f64> {
                    let z = DVector::from_fn(self.mean.len(), |_, _| StandardNormal.sample(stream));
                    &self.mean + &root * z
                };
                let mut x = draw();
                for _ in 0..REDRAWN {
                    if self.allowed(&x) {
                        break;
                    }
                    x = draw();
                }
                self.bounded(&x)
            })
            .collect()
    }

    /// Fits the distribution to the samples with the least losses; ties go to the earlier sample.
    pub fn tell(&mut self, samples: &[Sample], losses: &[f64]) {
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
    pub fn estimate(&self) -> Sample {
        self.bounded(&self.mean)
    }

    /// The current standard deviations.
    pub fn deviations(&self) -> Sample {
        self.covariance.diagonal().iter().map(|v| v.max(0.0).sqrt()).collect()
    }

    /// Number of elites.
    pub fn elites(&self) -> usize {
        self.config.elites
    }

    /// Whether a sample keeps within the limits that were asked for.
    fn allowed(&self, x: &DVector<f64>) -> bool {
        let limits = self.config.limits.iter().flatten().enumerate();
        limits.into_iter().all(|(i, [low, high])| (*low..=*high).contains(&x[i]))
    }

    fn bounded(&self, x: &DVector<f64>) -> Sample {
        // What is held has no part in the noise that keeps the covariance definite.
        let bounded = |((value, (_, sd)), [low, high]): ((&f64, (f64, f64)), [f64; 2])| {
            if sd > 0.0 { value.clamp(low, high) } else { 0.0 }
        };
        x.iter().zip(self.config.start()).zip(self.config.limits()).map(bounded).collect()
    }

    /// A square root of the covariance; the diagonal one if rounding made it indefinite.
    fn root(&self) -> DMatrix<f64> {
        let start = self.config.start();
        let jitter = DVector::from_fn(start.len(), |i, _| 1e-18 + 1e-12 * start[i].1.powi(2));
        match (&self.covariance + DMatrix::from_diagonal(&jitter)).cholesky() {
            Some(cholesky) => cholesky.l(),
            None => DMatrix::from_diagonal(&DVector::from_vec(self.deviations())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng;

    fn search(config: CemConfig, loss: impl Fn(&Sample) -> f64, iterations: usize) -> Cem {
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
    fn finds_the_bottom_of_a_tilted_bowl() {
        let truth = [0.6, 0.4, 0.8];
        let loss = |x: &Sample| {
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
    fn an_idle_direction_stays_wide() {
        // Density plays no part: its spread must not collapse the way restitution's does.
        let loss = |x: &Sample| (x[1] - 0.5).powi(2) + (x[2] - 0.5).powi(2);
        let found = search(CemConfig::fast(PRIOR), loss, 12);
        assert!(found.deviations()[0] > 10.0 * found.deviations()[2], "{:?}", found.deviations());
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
