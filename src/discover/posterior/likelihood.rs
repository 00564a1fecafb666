//! How likely trials are at points of one's own choice, for samplers of one's own: prepared once, asked as often as one likes.
//!
//! It is the density that [`super::posterior`] draws from, to the bit, with the same prior. How windows depend on
//! their starts is as at the fit, as it is there; variance components and a shared field that the model may lack are integrated out.

use serde_json::{Value, json};

use super::config::PosteriorConfig;
use super::density::Density;
use super::models::{Ask, with_models};
use super::prior::Known;
use crate::error::{Error, Result};
use crate::estimate::sampler::start::starts;
use crate::estimate::sampler::{Reference, Target as _, densities};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::task::Scene;
use crate::world::Sample;

/// What is said of one, as it is written.
pub const LIKELIHOOD_FORMAT: &str = "iplw.likelihood/1";

/// The likelihood of one set's model.
pub struct Likelihood {
    /// Names of the effects.
    set: Vec<String>,
    /// What each number of a point is.
    numbers: Vec<Known>,
    /// Where the fit stood.
    fit: Vec<f64>,
    /// Trials that had anything to say, and those that there were.
    trials: [usize; 2],
    /// Noise of an observed coordinate, m.
    noise: f64,
    density: Density,
    reference: Reference,
}

impl Likelihood {
    /// Of trials under the only set of the configuration; its sampler is nobody's concern.
    pub fn new(
        scene: &Scene,
        trials: &[Trial],
        config: &PosteriorConfig,
        progress: &dyn Progress,
    ) -> Result<Likelihood> {
        if config.sets.len() != 1 {
            return Err(Error::input("sets", format!("{} sets", config.sets.len()), "one set of effects"));
        }
        with_models(scene, trials, config, progress, |models, ready| {
            let model = &models[0].model;
            let (density, numbers, reference, fit) = Ask { model, ready, config }.likelihood()?;
            Ok(Likelihood {
                set: config.sets[0].clone(),
                numbers,
                fit,
                trials: [ready.kept.len(), trials.len()],
                noise: model.noise.sd,
                density,
                reference,
            })
        })
    }

    /// Name of every number of a point, as draws' columns have it.
    pub fn names(&self) -> Vec<String> {
        self.numbers.iter().map(Known::column).collect()
    }

    /// Log density of what is believed of a point beforehand; minus infinity where it is not allowed.
    pub fn log_prior(&self, point: &[f64]) -> f64 {
        let prior = self.density.prior();
        if prior.allows(point) { prior.log_density(point) } else { f64::NEG_INFINITY }
    }

    /// Log likelihoods of points, the same for any batch; minus infinity where the prior does not allow one, or nothing can be simulated.
    pub fn log_likelihoods(&self, points: &[Sample]) -> Result<Vec<f64>> {
        Ok(densities(&self.density, points, &mut 0)?.into_iter().map(|[_, likelihood]| likelihood).collect())
    }

    /// Points about the fit at which chains may begin: each is possible.
    pub fn starts(&self, count: usize, seed: u64) -> Result<Vec<Sample>> {
        let mut stream = rng::stream(seed, "starts");
        let found = starts(&self.density, &self.reference, count, &mut stream, &mut 0)?;
        Ok(found.into_iter().map(|(point, _)| point).collect())
    }

    /// Windows that are simulated for one point.
    pub fn windows(&self) -> usize {
        self.density.sizes().0
    }

    /// About how much memory it takes, bytes.
    pub fn bytes(&self) -> usize {
        self.density.bytes()
    }

    /// What is said of it, [`LIKELIHOOD_FORMAT`].
    pub fn document(&self) -> Value {
        let (windows, parts) = self.density.sizes();
        let parameter = |(number, fit): (&Known, &f64)| {
            json!({
                "name": number.column(),
                "unit": number.unit,
                "prior": number.prior,
                "fit": fit,
            })
        };
        json!({
            "format": LIKELIHOOD_FORMAT,
            "version": env!("CARGO_PKG_VERSION"),
            "effects": self.set,
            "parameters": self.numbers.iter().zip(&self.fit).map(parameter).collect::<Vec<_>>(),
            "trials": self.trials,
            "noise_m": self.noise,
            "windows": windows,
            "parts": parts,
        })
    }
}
