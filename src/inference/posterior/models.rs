//! Fits the model of every set of effects and prepares its likelihood.

use super::basis_field::{AllFields, DiscrepancyModel};
use super::config::PosteriorConfig;
use super::data_tempering::with_discrepancy_field;
use super::horizon::{
    FitData, HORIZON_STAGES, MAX_HORIZON, PreparedModel, extend_horizon, truncate_initial_segments,
};
use super::log_likelihood::{LogLikelihood, REFERENCE_INFLATION};
use super::prior::{self, ParameterPrior, parameter_priors};
use crate::error::{Error, Result};
use crate::estimate::sampler::{ReferenceDensity, Target as _, log_sum_exp};
use crate::inference::data::preprocessing::{PreprocessedData, preprocess};
use crate::inference::fit_base;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model::SegmentData;
use crate::inference::segment::SegmentKind;
use crate::inference::selection::candidates;
use crate::inference::selection::search::ModelSearch;
use crate::inference::selection::start_grid::add_strong_starts;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::world::latent::factor_index;

/// A model with its weight among all sets and its log evidence.
pub struct WeightedModel {
    pub model: PreparedModel,
    pub weight: f64,
    pub log_evidence: f64,
}

/// Fits the model of every set and passes the models to `of`.
pub fn fit_models<T>(
    scene: &Scene,
    trials: &[Trial],
    config: &PosteriorConfig,
    progress: &dyn Progress,
    of: impl FnOnce(&[WeightedModel], &PreprocessedData) -> Result<T>,
) -> Result<T> {
    config.validate()?;
    scene.validate()?;
    let latents = scene.calibrate.iter().map(|n| factor_index(n)).collect::<Result<Vec<_>>>()?;
    if latents.is_empty() && config.sets.iter().any(Vec::is_empty) {
        let allowed =
            "latents in the scene's calibrate list, or sets of effects; otherwise there are no parameters";
        return Err(Error::input("calibrate", "none", allowed));
    }
    let ready = preprocess(scene, trials, config.engine, MAX_HORIZON, &[], progress)?
        .and_then(PreprocessedData::with_enough_trials)
        .map_err(|lack| Error::input("trials", lack.reason, lack.action))?;
    progress.report("fitting the base model", 0, 1)?;
    let begun = match ready.untrimmed.iter().any(|w| w.kind == SegmentKind::FromInitialState) {
        true => Some(truncate_initial_segments(
            &ready.untrimmed,
            &vec![f64::INFINITY; ready.settings.len()],
            HORIZON_STAGES[0],
        )),
        false => None,
    };
    let windows = begun.as_deref().unwrap_or(&ready.segments);
    let opened = fit_base(scene, trials, &ready, windows, &latents, (config.engine, config.seed, progress))?;
    let fitter = ModelFitter::new(&opened.data, &ready.noise);
    let base = fitter.run_gls(opened.layout, opened.state)?.ok_or_else(base_model_failed)?;
    let mut candidates = candidates::candidates(scene, &candidates::summarise(fitter.data.segments));
    add_strong_starts(&fitter, &base, &mut candidates)?;
    let hunt = ModelSearch::new(&fitter, candidates, &latents, config.seed);
    let (observed, engine, seed) = (&opened.observed[..], config.engine, config.seed);
    let grounds = FitData { ready: &ready, progress, observed, engine, seed };
    let (mut models, mut log_evidences) = (Vec::new(), Vec::new());
    for (i, set) in config.sets.iter().enumerate() {
        progress.report("fitting sets of effects", i as u64, config.sets.len() as u64)?;
        let names: Vec<&str> = set.iter().map(String::as_str).collect();
        let fit = hunt.fit_named(&base, &names)?.ok_or_else(|| {
            let allowed = "effects that these trials identify (`iplw effects` describes each)";
            Error::input(format!("sets[{i}]"), set.join("+"), allowed)
        })?;
        let model = match begun.is_some() {
            true => {
                let found = extend_horizon(&grounds, &fit.layout, &fit.state.values)?;
                if config.sample_discrepancy {
                    with_discrepancy_field(&grounds, found, &config.prior, progress)?
                } else {
                    found
                }
            }
            false => PreparedModel {
                windows: ready.segments.clone(),
                sd: opened.data.sd.clone(),
                layout: fit.layout.clone(),
                state: fit.state.clone(),
                noise: ready.noise,
                loss: 0.0,
                field: None,
                draws: Vec::new(),
            },
        };
        log_evidences.push(fit.log_evidence);
        models.push(model);
    }
    of(&weigh(models, &log_evidences), &ready)
}

/// Weighs models by their evidence. Sets are compared on the same segments, independent of their horizons.
fn weigh(models: Vec<PreparedModel>, log_evidences: &[f64]) -> Vec<WeightedModel> {
    let all = log_sum_exp(log_evidences.iter().copied());
    let weighted = models.into_iter().zip(log_evidences);
    weighted.map(|(model, l)| WeightedModel { model, weight: libm::exp(l - all), log_evidence: *l }).collect()
}

fn base_model_failed() -> Error {
    Error::Failed("the log likelihood of the base model could not be evaluated".into())
}

/// Builds the likelihood of a model.
pub struct LikelihoodBuilder<'a> {
    pub model: &'a PreparedModel,
    pub ready: &'a PreprocessedData,
    pub config: &'a PosteriorConfig,
    /// Ends the computation once it is cancelled.
    pub progress: &'a dyn Progress,
}

impl LikelihoodBuilder<'_> {
    /// The likelihood, its parameters, the reference density and the fit's parameters.
    pub fn build(&self) -> Result<(LogLikelihood, Vec<ParameterPrior>, ReferenceDensity, Vec<f64>)> {
        let PreparedModel { windows, sd, layout, state, noise, .. } = self.model;
        let data = SegmentData::new(windows, &self.ready.settings, sd.clone(), self.config.engine);
        let data = data.until_stopped(self.progress);
        let fitter = ModelFitter::new(&data, noise);
        let fit = fitter.run_gls(layout.clone(), state.clone())?;
        let fit = fit.ok_or_else(|| {
            Error::Failed("the log likelihood of the fitted model could not be evaluated".into())
        })?;
        let (density, numbers) = self.prepare(&fitter, &fit)?;
        let reference = match self.model.draws.as_slice() {
            [] => density.reference(&fit),
            cloud => ReferenceDensity::from_points(cloud, REFERENCE_INFLATION, density.prior()),
        };
        Ok((density, numbers, reference, fit.state.values))
    }

    /// The likelihood of a fitted model, and its parameters.
    fn prepare(
        &self,
        fitter: &ModelFitter,
        fit: &FittedModel,
    ) -> Result<(LogLikelihood, Vec<ParameterPrior>)> {
        let numbers = parameter_priors(&fit.layout, &self.ready.setting_names, &self.config.prior);
        let prior = prior::joint_prior(&numbers)?;
        let lacks = match (&self.model.field, self.config.discrepancy) {
            (Some(field), _) => DiscrepancyModel::Sampled(field),
            (None, true) => {
                DiscrepancyModel::Marginalised(AllFields::along_paths(fitter, &fit.layout, &fit.state)?)
            }
            (None, false) => DiscrepancyModel::Absent,
        };
        let density = LogLikelihood::new(fitter, fit, prior, &lacks, self.config.seed)?;
        let failed = || Error::Failed("the segments cannot be simulated at the fit".into());
        Ok((density.ok_or_else(failed)?, numbers))
    }
}
