//! Requests for posteriors, and their translation into a configuration.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer};
use utoipa::ToSchema;

use super::diagnosis::{DiagnosisRequest, TrialFiles};
use crate::error::{Error, Result, check_range};
use crate::estimate::sampler::mcmc::McmcConfig;
use crate::estimate::sampler::smc::SmcConfig;
use crate::inference::posterior::{PosteriorConfig, Sampler};
use crate::json::JsonObject;
use crate::reality::TrackParseOptions;
use crate::task::Scene;
use crate::task::ball::BallScene;
use crate::world::Engine;
use crate::world::latent::factor_index;

/// Measured trials, their simulation, and the parameters to infer: latents and effect parameters.
#[derive(Clone, Default, Deserialize, ToSchema, clap::Args)]
#[serde(deny_unknown_fields)]
#[schema(as = PosteriorIn)]
pub struct PosteriorRequest {
    /// An `iplw.scene/1` document; its `calibrate` lists the latents to infer.
    #[arg(skip)]
    #[schema(value_type = Option<Object>)]
    pub scene: Option<JsonObject<Scene>>,
    /// A single ball, instead of a scene.
    #[arg(skip)]
    #[schema(value_type = Option<BallScene>)]
    pub ball: Option<JsonObject<BallScene>>,
    /// Trials as CSV, as for a diagnosis.
    #[arg(skip)]
    pub trials: Option<TrialFiles>,
    /// Units and options for reading the trials.
    #[arg(skip)]
    #[schema(value_type = Option<TrackParseOptions>)]
    pub reading: Option<JsonObject<TrackParseOptions>>,
    /// Id of an estimation, to use its trials so far.
    #[arg(skip)]
    pub job: Option<String>,
    /// Sets of effects, one model each, weighted by their log evidence. Default: one empty set.
    #[arg(long = "set", value_name = "EFFECTS", value_parser = |text: &str| Ok::<_, Error>(effect_set(text)))]
    #[arg(
        help = "Effects of a model, joined by +; may be repeated: models are weighted by predictive density [default: none]"
    )]
    #[schema(value_type = Option<Vec<Vec<String>>>)]
    pub sets: Option<Vec<EffectSet>>,
    /// Latents to infer, instead of the scene's `calibrate`.
    #[arg(long, value_delimiter = ',', value_name = "LATENT,..")]
    pub calibrate: Option<Vec<String>>,
    /// Mean and standard deviation by latent. Default: 1 and 0.5; restitution 0.5 and 0.25.
    #[arg(long, value_name = "LATENT=MEAN:SD", value_parser = latent_prior)]
    #[serde(default, deserialize_with = "latent_priors")]
    #[schema(value_type = Option<BTreeMap<String, [f64; 2]>>)]
    pub prior: Vec<(String, [f64; 2])>,
    /// `smc` (sequential Monte Carlo) or `mcmc` (Markov chains).
    #[arg(long, help = "Sampler: smc (sequential Monte Carlo) or mcmc (Markov chains) [default: smc]")]
    pub method: Option<String>,
    /// Total number of draws. Default: 1024.
    #[arg(long)]
    pub draws: Option<usize>,
    /// Whether to account for model discrepancy shared by the trials. Default: true.
    #[arg(long = "no-discrepancy", num_args = 0, default_missing_value = "false")]
    #[arg(help = "Assume that the model is complete: no allowance for model discrepancy")]
    pub discrepancy: Option<bool>,
    /// Whether a likely discrepancy field is simulated and sampled with the parameters: wider, more honest intervals, for minutes of
    /// CPU time instead of seconds. Requires `discrepancy`. Default: false.
    #[arg(long, num_args = 0, default_missing_value = "true", conflicts_with = "discrepancy")]
    #[arg(help = "Also sample an unknown force field: wider, more honest intervals; takes a minute or more")]
    pub sample_discrepancy: Option<bool>,
    #[arg(long, help = "Random seed [default: 0]")]
    pub seed: Option<u64>,
    /// Physics engine: auto, rapier, lanes or gpu.
    #[arg(long, default_value = "auto", value_parser = Engine::from_name)]
    #[serde(skip)]
    pub engine: Engine,
}

/// Effects by name: a model in addition to the scene.
pub(super) type EffectSet = Vec<String>;

/// Minimum and maximum number of draws.
const DRAW_LIMITS: [f64; 2] = [64.0, 100_000.0];
/// Default total number of draws.
const DEFAULT_DRAWS: usize = 1024;

impl PosteriorRequest {
    /// Builds the configuration. Errors name the invalid field.
    pub fn config(&self) -> Result<PosteriorConfig> {
        let seed = self.seed.unwrap_or(0);
        let standard = PosteriorConfig::standard(seed);
        let mut prior = standard.prior;
        for (name, [mean, sd]) in &self.prior {
            prior[factor_index(name)?] = (*mean, *sd);
        }
        let draws = self.draws.unwrap_or(DEFAULT_DRAWS);
        check_range("draws", draws as f64, DRAW_LIMITS[0], DRAW_LIMITS[1])?;
        let sampler = match self.method.as_deref().unwrap_or("smc") {
            "smc" => {
                let config = SmcConfig::standard(seed);
                Sampler::Smc(SmcConfig { particles: draws.div_ceil(config.runs), ..config })
            }
            "mcmc" => {
                let config = McmcConfig::standard(seed);
                Sampler::Mcmc(McmcConfig { steps: draws.div_ceil(config.chains).max(8), ..config })
            }
            other => return Err(Error::input("method", format!("{other:?}"), "smc or mcmc")),
        };
        let config = PosteriorConfig {
            sets: self.sets.clone().filter(|sets| !sets.is_empty()).unwrap_or(standard.sets),
            prior,
            discrepancy: self.discrepancy.unwrap_or(standard.discrepancy),
            sample_discrepancy: self.sample_discrepancy.unwrap_or(standard.sample_discrepancy),
            sampler,
            engine: self.engine,
            seed,
        };
        config.validate()?;
        Ok(config)
    }

    /// The measured trials and their simulation.
    pub fn into_data(self) -> DiagnosisRequest {
        let PosteriorRequest { scene, ball, trials, reading, job, seed, .. } = self;
        DiagnosisRequest { scene, ball, trials, reading, job, seed }
    }
}

/// Replaces the latents of `scene` to infer by those of a request, if it names any.
pub fn set_calibrate(scene: &mut Scene, calibrate: Option<Vec<String>>) -> Result<()> {
    let Some(latents) = calibrate else { return Ok(()) };
    latents.iter().try_for_each(|name| factor_index(name).map(drop))?;
    scene.calibrate = latents;
    scene.validate().map_err(|e| e.in_field("scene"))
}

/// Errors if a request that has a posterior also has one of these fields, by name and whether it is set.
pub(super) fn exclude_with_posterior(fields: &[(&str, bool)]) -> Result<()> {
    match fields.iter().find(|(_, is_set)| *is_set) {
        Some((field, _)) => Err(Error::input(*field, "given together with posterior", "one or the other")),
        None => Ok(()),
    }
}

/// Effects joined by `+`; `none` is an empty set.
pub fn effect_set(text: &str) -> Vec<String> {
    match text.trim() {
        "none" => Vec::new(),
        names => names.split('+').map(|n| n.trim().to_string()).collect(),
    }
}

/// `LATENT=MEAN:SD`.
fn latent_prior(text: &str) -> Result<(String, [f64; 2])> {
    let number = |t: &str| t.trim().parse().ok().filter(|v: &f64| v.is_finite());
    let parsed = text.split_once('=').and_then(|(name, rest)| {
        let (mean, sd) = rest.split_once(':')?;
        Some((name.trim().to_string(), [number(mean)?, number(sd)?]))
    });
    parsed.ok_or_else(|| Error::input("", "", "LATENT=MEAN:SD, such as friction=0.5:0.25"))
}

/// An object of priors by latent, or null.
fn latent_priors<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> std::result::Result<Vec<(String, [f64; 2])>, D::Error> {
    let priors = Option::<BTreeMap<String, [f64; 2]>>::deserialize(deserializer)?;
    Ok(priors.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unset_options_have_defaults() {
        assert_eq!(PosteriorRequest::default().config().unwrap(), PosteriorConfig::standard(0));
        let request = PosteriorRequest {
            prior: vec![latent_prior("friction=0.3:0.1").unwrap()],
            draws: Some(100),
            method: Some("mcmc".into()),
            ..PosteriorRequest::default()
        };
        let config = request.config().unwrap();
        assert_eq!(config.prior[factor_index("friction").unwrap()], (0.3, 0.1));
        assert!(matches!(config.sampler, Sampler::Mcmc(McmcConfig { steps: 8, .. })), "{:?}", config.sampler);
    }

    #[test]
    fn rejects_invalid_options_by_name() {
        let refused = |request: PosteriorRequest, name: &str| {
            let error = request.config().unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        let with_sets = |sets| PosteriorRequest { sets: Some(sets), ..PosteriorRequest::default() };
        let with_prior = |prior: (&str, [f64; 2])| PosteriorRequest {
            prior: vec![(prior.0.into(), prior.1)],
            ..PosteriorRequest::default()
        };
        refused(PosteriorRequest { method: Some("hmc".into()), ..PosteriorRequest::default() }, "method");
        refused(PosteriorRequest { draws: Some(3), ..PosteriorRequest::default() }, "draws");
        refused(with_sets(vec![vec!["ether".into()]]), "ether");
        refused(with_sets(vec![vec!["wind".into(); 2]]), "sets[0]");
        refused(with_prior(("grip", [1.0, 1.0])), "grip");
        refused(with_prior(("friction", [1.0, 0.0])), "prior");
        assert!(latent_prior("friction=1").is_err());
    }
}
