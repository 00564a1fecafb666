//! Likelihood of trials at arbitrary parameters, for external samplers: prepared once, evaluated many times.
//!
//! It is bit for bit the density that [`super::posterior`] samples, with the same prior. The dependence of
//! segments on their initial states is fixed at the fit; variance components and shared model discrepancy are
//! integrated out.

use serde_json::{Value, json};

use super::config::PosteriorConfig;
use super::log_likelihood::LogLikelihood;
use super::models::{LikelihoodBuilder, fit_models};
use super::prior::ParameterPrior;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::estimate::sampler::initial_points::initial_points;
use crate::estimate::sampler::{ReferenceDensity, Target as _, log_densities};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::task::Scene;
use crate::world::ParameterVector;

/// Format identifier of a likelihood's description.
pub const LIKELIHOOD_FORMAT: &str = "iplw.likelihood/1";

/// The likelihood of one model.
pub struct TrialLikelihood {
    /// Names of the effects.
    set: Vec<String>,
    /// Parameters in the order of a point.
    parameters: Vec<ParameterPrior>,
    /// Parameters of the fit.
    fit: Vec<f64>,
    /// Number of informative trials, and of all trials.
    trials: [usize; 2],
    /// Standard deviation of the noise of an observed coordinate, m.
    noise: f64,
    likelihood: LogLikelihood,
    reference: ReferenceDensity,
}

impl TrialLikelihood {
    /// Prepares the likelihood of trials under the configuration's single set; its sampler is ignored.
    pub fn new(
        scene: &Scene,
        trials: &[Trial],
        config: &PosteriorConfig,
        progress: &dyn Progress,
    ) -> Result<TrialLikelihood> {
        if config.sets.len() != 1 {
            return Err(Error::input("sets", format!("{} sets", config.sets.len()), "one set of effects"));
        }
        fit_models(scene, trials, config, progress, |models, ready| {
            let model = &models[0].model;
            let (density, numbers, reference, fit) =
                LikelihoodBuilder { model, ready, config, progress }.build()?;
            Ok(TrialLikelihood {
                set: config.sets[0].clone(),
                parameters: numbers,
                fit,
                trials: [ready.trial_indices.len(), trials.len()],
                noise: model.noise.sd,
                likelihood: density,
                reference,
            })
        })
    }

    /// Parameter names, as in the columns of draws.
    pub fn names(&self) -> Vec<String> {
        self.parameters.iter().map(ParameterPrior::column).collect()
    }

    /// Log prior density of a point; minus infinity outside the bounds.
    pub fn log_prior(&self, point: &[f64]) -> f64 {
        let prior = self.likelihood.prior();
        if prior.contains(point) { prior.log_density(point) } else { f64::NEG_INFINITY }
    }

    /// Log likelihoods of points, independent of batching; minus infinity outside the prior's bounds or if the
    /// simulation fails. Ends early with `budget`.
    pub fn log_likelihoods(&self, points: &[ParameterVector], budget: &dyn Budget) -> Result<Vec<f64>> {
        Ok(log_densities(&self.likelihood, points, &mut 0, budget)?
            .into_iter()
            .map(|[_, likelihood]| likelihood)
            .collect())
    }

    /// Initial points for chains, near the fit and with finite density.
    pub fn initial_points(
        &self,
        count: usize,
        seed: u64,
        budget: &dyn Budget,
    ) -> Result<Vec<ParameterVector>> {
        let mut stream = rng::stream(seed, "starts");
        let found = initial_points(&self.likelihood, &self.reference, count, &mut stream, &mut 0, budget)?;
        Ok(found.into_iter().map(|(point, _)| point).collect())
    }

    /// Number of segments simulated per point.
    pub fn segment_count(&self) -> usize {
        self.likelihood.sizes().0
    }

    /// Approximate memory, bytes.
    pub fn bytes(&self) -> usize {
        self.likelihood.bytes()
    }

    /// Description in JSON, [`LIKELIHOOD_FORMAT`].
    pub fn document(&self) -> Value {
        let (windows, parts) = self.likelihood.sizes();
        let parameter = |(number, fit): (&ParameterPrior, &f64)| {
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
            "parameters": self.parameters.iter().zip(&self.fit).map(parameter).collect::<Vec<_>>(),
            "trials": self.trials,
            "noise_m": self.noise,
            "windows": windows,
            "parts": parts,
        })
    }
}
