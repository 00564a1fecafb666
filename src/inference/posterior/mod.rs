//! Posterior sampling of latents and effect parameters given trials, for one or several models (sets of
//! effects).
//!
//! 1. Trials are cut into segments and the model of every set is fitted, as in a diagnosis. `models`: fits;
//!    `horizon`: extends segments from known initial states as far as the model predicts them.
//! 2. `log_likelihood`: likelihood of the segments at any parameters, linearised in the nuisances at the fit.
//!    `conditional`: the likelihood given variance components, which are integrated out by a mean over draws.
//!    `discrepancy`: shared model discrepancy is integrated out, too. `data_tempering`: on request the
//!    discrepancy becomes part of the model instead (`basis_field`), sampled with the parameters
//!    (`sampled_field`). `whitened`: whitened residuals; `prior`: priors of the parameters.
//! 3. `estimate::sampler` samples, starting near the fit. `likelihood`: the same density for external samplers.
//! 4. Sets are weighted by their log evidence (Laplace); that of the draws is reported in addition. `document`: the
//!    output format; `config`: the configuration.
//!
//! Sources: sequential Monte Carlo (Del Moral, Doucet and Jasra 2006), model discrepancy (Kennedy and O'Hagan
//! 2001), stacking by bootstrapped predictive densities (Yao et al. 2018).
//!
//! Range of validity: the dependence of segments on their unknown initial states is fixed at the fit, and so is
//! the noise.

mod basis_field;
mod conditional;
mod config;
mod data_tempering;
mod discrepancy;
mod document;
mod horizon;
mod likelihood;
mod log_likelihood;
mod models;
mod predictive_bands;
mod prior;
mod sampled_field;
mod whitened;

use crate::error::Result;
use crate::estimate::sampler::PosteriorDraws;
use crate::estimate::sampler::mcmc::mcmc;
use crate::estimate::sampler::smc::smc;
use crate::inference::field::FieldInputs;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::task::Scene;
pub use config::{PosteriorConfig, Sampler};
pub use discrepancy::DiscrepancyField;
pub use document::{ParameterSummary, PosteriorDocument, SetSummary};
pub use horizon::MAX_HORIZON;
pub use likelihood::{LIKELIHOOD_FORMAT, TrialLikelihood};
use log_likelihood::DiscrepancySummary;
pub use log_likelihood::{FieldDraws, LogLikelihood};
use models::{LikelihoodBuilder, WeightedModel, fit_models};
pub use predictive_bands::PredictiveBand;
use predictive_bands::predictive_bands;
pub use prior::ParameterPrior;

/// Factor on the number of moves where a field is sampled.
const FIELD_MOVE_FACTOR: usize = 2;

/// Posterior of every set of effects.
#[derive(Clone, Debug)]
pub struct Posterior {
    pub sets: Vec<ModelPosterior>,
    /// Number of informative trials, and of all trials.
    pub trials: [usize; 2],
    /// Standard deviation of the noise of an observed coordinate, m.
    pub noise: f64,
    /// Predictions of some trials under the draws of the most probable set.
    pub predictive: Vec<PredictiveBand>,
}

/// The posterior of one set of effects.
#[derive(Clone, Debug)]
pub struct ModelPosterior {
    /// Names of the effects.
    pub set: Vec<String>,
    /// Parameters in the order of a draw.
    pub parameters: Vec<ParameterPrior>,
    /// Parameters of the fit.
    pub fit: Vec<f64>,
    pub draws: PosteriorDraws,
    /// Posterior probability of each shared discrepancy field, no field first.
    pub fields: Vec<(DiscrepancyField, f64)>,
    pub field_draws: Vec<FieldDraws>,
    /// Inputs of the discrepancy field that is part of the model, if any.
    pub sampled_field: Option<FieldInputs>,
    /// Model weight by predictive density of held-out trials.
    pub weight: f64,
    pub log_evidence: f64,
    /// Number of segments simulated for a likelihood, and of groups that it is a product over.
    pub segments_and_groups: (usize, usize),
}

/// Samples the posterior of a scene's latents (those in `calibrate`) and of effect parameters.
pub fn posterior(
    scene: &Scene,
    trials: &[Trial],
    config: &PosteriorConfig,
    progress: &dyn Progress,
) -> Result<Posterior> {
    fit_models(scene, trials, config, progress, |models, ready| {
        let mut sets = Vec::with_capacity(models.len());
        let mut noise = f64::INFINITY;
        for (s, WeightedModel { model, weight, log_evidence }) in models.iter().enumerate() {
            let own = LikelihoodBuilder { model, ready, config, progress };
            let (density, numbers, reference, fit) = own.build()?;
            // A field adds many parameters, and particles take longer to decorrelate.
            let more = if model.field.is_some() { FIELD_MOVE_FACTOR } else { 1 };
            let draws = match &config.sampler {
                Sampler::Smc(own) => smc(&density, &reference, &own.with_more_moves(more), progress)?,
                Sampler::Mcmc(own) => mcmc(&density, &reference, own, progress)?,
            };
            noise = noise.min(model.noise.sd);
            let DiscrepancySummary { fields, draws: carried } = density.summarise_discrepancy(
                &draws.points,
                rng::derive_seed(config.seed, "lacking", s as u64),
                &progress,
            )?;
            sets.push(ModelPosterior {
                set: model.named_terms().iter().map(|t| t.effect.name.to_string()).collect(),
                parameters: numbers,
                fit,
                fields,
                field_draws: carried,
                sampled_field: model.field.as_ref().map(|u| u.over),
                draws,
                weight: *weight,
                log_evidence: *log_evidence,
                segments_and_groups: density.sizes(),
            });
        }
        let best = (0..models.len()).max_by(|a, b| models[*a].weight.total_cmp(&models[*b].weight));
        let predictive = match best {
            Some(s) => {
                let points = &sets[s].draws.points;
                predictive_bands(&models[s].model, ready, trials, points, config.engine, progress)?
            }
            None => Vec::new(),
        };
        Ok(Posterior { sets, trials: [ready.trial_indices.len(), trials.len()], noise, predictive })
    })
}
