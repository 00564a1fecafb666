//! Models of sets of effects, fitted and ready to be asked how likely trials are.

use super::config::PosteriorConfig;
use super::density::{Density, WIDER};
use super::follow::completed;
use super::prior::{self, Known, known};
use super::reach::{Grounds, OfModel, RUN, STAGES, cut, reached};
use super::unnamed::{Every, Lacks};
use crate::discover::decide::Bootstrap;
use crate::discover::fit::{Fitted, Fitter};
use crate::discover::model::Data;
use crate::discover::open;
use crate::discover::prepare::{Ready, prepare};
use crate::discover::search::Hunt;
use crate::discover::window::Kind;
use crate::error::{Error, Result};
use crate::estimate::sampler::{Reference, Target as _};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::task::Scene;
use crate::world::latent::factor_index;

/// A model, how much its set weighs among all, and how likely launches are, each told from the others.
pub struct Weighed {
    pub model: OfModel,
    pub weight: f64,
    pub predictive: f64,
}

/// Fits the model of every set and hands the models over.
pub fn with_models<T>(
    scene: &Scene,
    trials: &[Trial],
    config: &PosteriorConfig,
    progress: &dyn Progress,
    of: impl FnOnce(&[Weighed], &Ready) -> Result<T>,
) -> Result<T> {
    config.validate()?;
    scene.validate()?;
    let latents = scene.calibrate.iter().map(|n| factor_index(n)).collect::<Result<Vec<_>>>()?;
    if latents.is_empty() && config.sets.iter().any(Vec::is_empty) {
        let allowed =
            "latents for the scene to calibrate, or effects: there is nothing to be known otherwise";
        return Err(Error::input("calibrate", "none", allowed));
    }
    let ready = match prepare(scene, trials, config.engine, RUN)? {
        Ok(ready) => ready,
        Err(lack) => return Err(Error::input("trials", lack.reason, lack.action)),
    };
    progress.report("fitting the base model", 0, 1)?;
    let begun = match ready.whole.iter().any(|w| w.kind == Kind::Run) {
        true => Some(cut(&ready.whole, &vec![f64::INFINITY; ready.settings.len()], STAGES[0])),
        false => None,
    };
    let windows = begun.as_deref().unwrap_or(&ready.windows);
    let opened = open(scene, trials, &ready, windows, &latents, (config.engine, config.seed))?;
    let fitter = Fitter::new(&opened.data, &ready.noise);
    let base = fitter.refined(opened.layout, opened.state)?;
    let base = base.ok_or_else(|| Error::Failed("the base model could not be scored".into()))?;
    let hunt = Hunt::new(scene, &fitter, &latents, config.seed);
    let grounds =
        Grounds { ready: &ready, observed: &opened.observed, engine: config.engine, seed: config.seed };
    let (mut models, mut scores) = (Vec::new(), Vec::new());
    for (i, set) in config.sets.iter().enumerate() {
        progress.report("fitting sets of effects", i as u64, config.sets.len() as u64)?;
        let names: Vec<&str> = set.iter().map(String::as_str).collect();
        let fit = hunt.named(&base, &names)?.ok_or_else(|| {
            let allowed =
                "effects that these trials can tell anything of (`iplw effects` says what each does)";
            Error::input(format!("sets[{i}]"), set.join("+"), allowed)
        })?;
        let model = match begun.is_some() {
            true => {
                let found = reached(&grounds, &fit.layout, &fit.state.values)?;
                if config.follow { completed(&grounds, found, &config.prior, progress)? } else { found }
            }
            false => OfModel {
                windows: ready.windows.clone(),
                sd: opened.data.sd.clone(),
                layout: fit.layout.clone(),
                state: fit.state.clone(),
                noise: ready.noise,
                left: 0.0,
                unnamed: None,
                cloud: Vec::new(),
            },
        };
        scores.push(fit.score);
        models.push(model);
    }
    // Sets are weighed on the same windows, whatever each of them makes of longer ones.
    let launches = scores.first().map_or(0, Vec::len);
    let weights = Bootstrap::new(launches, rng::derive(config.seed, "sets", 0)).weights(&scores);
    let weighed = models.into_iter().zip(weights).zip(&scores);
    let weighed: Vec<Weighed> = weighed
        .map(|((model, weight), score)| Weighed { model, weight, predictive: score.iter().sum() })
        .collect();
    of(&weighed, &ready)
}

/// A model whose likelihood is asked for.
pub struct Ask<'a> {
    pub model: &'a OfModel,
    pub ready: &'a Ready,
    pub config: &'a PosteriorConfig,
}

impl Ask<'_> {
    /// The likelihood, what its numbers are, where draws begin, and where the fit stands.
    pub fn likelihood(&self) -> Result<(Density, Vec<Known>, Reference, Vec<f64>)> {
        let OfModel { windows, sd, layout, state, noise, .. } = self.model;
        let data = Data::new(windows, &self.ready.settings, sd.clone(), self.config.engine);
        let fitter = Fitter::new(&data, noise);
        let fit = fitter.refined(layout.clone(), state.clone())?;
        let fit =
            fit.ok_or_else(|| Error::Failed("the model could not be scored where its fit stands".into()))?;
        let (density, numbers) = self.ready_to_draw(&fitter, &fit)?;
        let reference = match self.model.cloud.as_slice() {
            [] => density.reference(&fit),
            cloud => Reference::about(cloud, WIDER, density.prior()),
        };
        Ok((density, numbers, reference, fit.state.values))
    }

    /// The likelihood of a fitted model, and what its numbers are.
    fn ready_to_draw(&self, fitter: &Fitter, fit: &Fitted) -> Result<(Density, Vec<Known>)> {
        let numbers = known(&fit.layout, &self.ready.names, &self.config.prior);
        let prior = prior::of(&numbers)?;
        let lacks = match (&self.model.unnamed, self.config.discrepancy) {
            (Some(unnamed), _) => Lacks::Known(unnamed),
            (None, true) => Lacks::Any(Every::of(fitter, &fit.layout, &fit.state)?),
            (None, false) => Lacks::Nothing,
        };
        let density = Density::new(fitter, fit, prior, &lacks, self.config.seed)?;
        let failed = || Error::Failed("the windows cannot be simulated where the fit stands".into());
        Ok((density.ok_or_else(failed)?, numbers))
    }
}
