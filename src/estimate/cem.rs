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

use nalgebra::{Matrix4, Vector4};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, within};
use crate::rng::Stream;
use crate::world::latent::FACTORS;

/// One point of the search: density (kg/m^2), friction, restitution, and c of `linear_drag` (1/s).
pub type Sample = [f64; 4];

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
    /// Mean and standard deviation of the coefficient c (1/s) of an effect `linear_drag` that the simulation is
    /// given and that is fitted along; `None` leaves the simulation without.
    #[serde(default)]
    pub drag: Option<(f64, f64)>,
    /// Standard deviations never shrink below this share of the prior's.
    pub floor: f64,
    /// Least and greatest density, friction and restitution to be considered; `None` leaves the factors' bounds.
    /// Samples beyond are drawn again, up to [`REDRAWN`] times, then moved to the limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<[[f64; 2]; 3]>,
}

/// Most times a sample beyond a limit is drawn again. With half of the distribution beyond, all but one in 10^9 get in.
const REDRAWN: usize = 30;

/// Where a search stands, as plain data: [`Cem::at`] takes it up again to the bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Mean of every component.
    pub mean: Sample,
    /// Covariance, by rows.
    pub covariance: [Sample; 4],
}

/// The state of the search.
#[derive(Clone, Debug)]
pub struct Cem {
    config: CemConfig,
    mean: Vector4<f64>,
    covariance: Matrix4<f64>,
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
            floor: 0.02,
            limits: None,
        }
    }

    /// Where the search starts: mean and standard deviation of every component; (0, 0) for one left out.
    pub fn start(&self) -> [(f64, f64); 4] {
        let [density, friction, restitution] = self.prior;
        [density, friction, restitution, self.drag.unwrap_or((0.0, 0.0))]
    }

    /// Least and greatest value of every component.
    pub fn limits(&self) -> [[f64; 2]; 4] {
        let factors = self.limits.unwrap_or(FACTORS.map(|f| f.bounds));
        std::array::from_fn(|i| factors.get(i).copied().unwrap_or([0.0, 100.0]))
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
        let [start, limits] = [config.start().map(|p| [p.0, p.1]), config.limits()];
        let mean = Vector4::from_fn(|i, _| match config.limits {
            Some(_) => start[i][0].clamp(limits[i][0], limits[i][1]),
            None => start[i][0],
        });
        let covariance = Matrix4::from_diagonal(&Vector4::from_fn(|i, _| config.start()[i].1.powi(2)));
        Ok(Cem { config, mean, covariance })
    }

    /// The search as it stood at `state`.
    pub fn at(config: CemConfig, state: &State) -> Result<Cem> {
        config.validate()?;
        let covariance = Matrix4::from_fn(|i, j| state.covariance[i][j]);
        Ok(Cem { config, mean: Vector4::from(state.mean), covariance })
    }

    /// Where the search stands.
    pub fn state(&self) -> State {
        let row = |i: usize| std::array::from_fn(|j| self.covariance[(i, j)]);
        State { mean: self.mean.into(), covariance: std::array::from_fn(row) }
    }

    /// The next iteration's samples, each within bounds.
    pub fn ask(&self, stream: &mut Stream) -> Vec<Sample> {
        let root = self.root();
        (0..self.config.samples)
            .map(|_| {
                let mut draw = || -> Vector4<f64> {
                    let z = Vector4::from_fn(|_, _| StandardNormal.sample(stream));
                    self.mean + root * z
                };
                let mut x = draw();
                for _ in 0..REDRAWN {
                    if self.allowed(x) {
                        break;
                    }
                    x = draw();
                }
                self.bounded(x)
            })
            .collect()
    }

    /// Fits the distribution to the samples with the least losses; ties go to the earlier sample.
    pub fn tell(&mut self, samples: &[Sample], losses: &[f64]) {
        let mut order: Vec<usize> = (0..samples.len()).collect();
        order.sort_by(|a, b| losses[*a].total_cmp(&losses[*b]));
        order.truncate(self.config.elites);
        let n = order.len() as f64;
        let elite = |i: &usize| Vector4::from(samples[*i]);
        let mean = order.iter().map(elite).sum::<Vector4<f64>>() / n;
        let scatter =
            order.iter().map(|i| (elite(i) - mean) * (elite(i) - mean).transpose()).sum::<Matrix4<f64>>();
        let keep = self.config.smoothing;
        self.mean = self.mean * keep + mean * (1.0 - keep);
        self.covariance = self.covariance * keep + scatter / n * (1.0 - keep);
        for (i, start) in self.config.start().iter().enumerate() {
            let floor = (self.config.floor * start.1).powi(2);
            self.covariance[(i, i)] = self.covariance[(i, i)].max(floor);
        }
    }

    /// The current estimate, within bounds.
    pub fn estimate(&self) -> Sample {
        self.bounded(self.mean)
    }

    /// The current standard deviations.
    pub fn deviations(&self) -> [f64; 4] {
        std::array::from_fn(|i| self.covariance[(i, i)].max(0.0).sqrt())
    }

    /// Number of elites.
    pub fn elites(&self) -> usize {
        self.config.elites
    }

    /// Whether a sample keeps within the limits that were asked for.
    fn allowed(&self, x: Vector4<f64>) -> bool {
        let limits = self.config.limits.iter().flatten().enumerate();
        limits.into_iter().all(|(i, [low, high])| (*low..=*high).contains(&x[i]))
    }

    fn bounded(&self, x: Vector4<f64>) -> Sample {
        let limits = self.config.limits();
        std::array::from_fn(|i| {
            if i == 3 && self.config.drag.is_none() { 0.0 } else { x[i].clamp(limits[i][0], limits[i][1]) }
        })
    }

    /// A square root of the covariance; the diagonal one if rounding made it indefinite.
    fn root(&self) -> Matrix4<f64> {
        let jitter = Matrix4::from_diagonal(&Vector4::from_fn(|i, _| {
            1e-18 + 1e-12 * self.config.start()[i].1.powi(2)
        }));
        match (self.covariance + jitter).cholesky() {
            Some(cholesky) => cholesky.l(),
            None => Matrix4::from_diagonal(&Vector4::from(self.deviations())),
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
