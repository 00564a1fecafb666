//! What is known of latents and effects, given trials: draws from the posterior, of one set of effects or of several.
//!
//! 1. Trials are cut into windows and the model of every set is fitted, as a diagnosis does it.
//!    `reach`: beginnings of trials, whose starts are known, go on as far as the model predicts them.
//! 2. `density`: how likely the windows are at any values, about that fit; `discrepancy`: what launches share that the model lacks
//!    is integrated out; `prior`: what is believed of every number.
//! 3. `estimate::sampler` draws, beginning near the fit.
//! 4. Sets are weighed by how well each predicts launches from the others (`decide`); their evidence stands beside that.
//!    `document`: all of it as it is written; `wanted`: what people say they want.
//!
//! Sources: sequential Monte Carlo (Del Moral, Doucet and Jasra 2006), model discrepancy (Kennedy and O'Hagan 2001), stacking by
//! bootstrapped predictive densities (Yao et al. 2018).
//!
//! Range of validity: how windows depend on their unknown starts, and variance components, are held at the fit.

mod density;
mod discrepancy;
mod document;
mod prior;
mod reach;
mod wanted;

use serde::{Deserialize, Serialize};

use super::decide::Bootstrap;
use super::field::OVERS;
use super::fit::{Fitted, Fitter};
use super::model::{Data, Extra, Layout, State, paths};
use super::noise::Noise;
use super::prepare::{Ready, prepare};
use super::search::Hunt;
use super::window::{Kind, Window};
use super::{field, open};
use crate::error::{Error, Result};
use crate::estimate::sampler::mcmc::{McmcConfig, mcmc};
use crate::estimate::sampler::smc::{SmcConfig, smc};
use crate::estimate::sampler::{Draws, Reference};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::task::Scene;
use crate::world::Engine;
use crate::world::effect::{Effect, find};
use crate::world::latent::factor_index;
pub use density::Density;
pub use discrepancy::Field;
use discrepancy::Kinds;
pub use document::{Document, FORMAT};
pub use prior::{Known, known};
use reach::{Grounds, RUN, STAGES, cut, reached};
pub use wanted::Wanted;

/// What a posterior is asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PosteriorConfig {
    /// Sets of effects by name, each a model of its own; an empty set is the scene as it is.
    pub sets: Vec<Vec<String>>,
    /// Mean and standard deviation of density, friction and restitution as believed beforehand, cut off at their bounds.
    pub prior: [(f64, f64); 3],
    /// Whether what launches share and the model lacks may be there, and is integrated out.
    pub discrepancy: bool,
    pub sampler: Sampler,
    pub engine: Engine,
    pub seed: u64,
}

/// How draws are made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Sampler {
    /// Sequential Monte Carlo.
    Smc(SmcConfig),
    /// Markov chains, as Galileo has it.
    Mcmc(McmcConfig),
}

/// Draws from the posterior of every set.
#[derive(Clone, Debug)]
pub struct Posterior {
    pub sets: Vec<OfSet>,
    /// Trials that had anything to say, and those that there were.
    pub trials: [usize; 2],
    /// Noise of an observed coordinate, m.
    pub noise: f64,
}

/// The posterior of one set of effects.
#[derive(Clone, Debug)]
pub struct OfSet {
    /// Names of the effects.
    pub set: Vec<String>,
    /// What each number of a point is.
    pub numbers: Vec<Known>,
    /// Where the fit stood.
    pub fit: Vec<f64>,
    pub draws: Draws,
    /// Probability of each kind of shared field that the model may lack, the first of which is none.
    pub fields: Vec<(Field, f64)>,
    /// Probability of the set among all, by how it predicts launches; and how likely each launch was, told from the others.
    pub weight: f64,
    pub predictive: f64,
    /// Windows that are simulated for a likelihood, and parts of launches that it is a product over.
    pub sizes: (usize, usize),
}

/// By how much the reference is wider than the fit says.
const WIDER: f64 = 1.5;
/// Amplitude by which derivatives by a field's functions are taken, m/s^2.
const SLIGHT: f64 = 0.02;

impl PosteriorConfig {
    /// The scene as it is, a thousand draws, the paper's prior.
    pub fn standard(seed: u64) -> PosteriorConfig {
        PosteriorConfig {
            sets: vec![Vec::new()],
            prior: [(1.0, 0.5), (1.0, 0.5), (0.5, 0.25)],
            discrepancy: true,
            sampler: Sampler::Smc(SmcConfig::standard(seed)),
            engine: Engine::Auto,
            seed,
        }
    }

    /// Errors name what is out of range.
    pub fn validate(&self) -> Result<()> {
        if self.sets.is_empty() || self.sets.len() > 20 {
            return Err(Error::input("sets", format!("{} sets", self.sets.len()), "1 to 20 sets of effects"));
        }
        for (i, set) in self.sets.iter().enumerate() {
            if set.len() > 4 {
                return Err(Error::input(
                    format!("sets[{i}]"),
                    format!("{} effects", set.len()),
                    "at most 4",
                ));
            }
            for (k, name) in set.iter().enumerate() {
                find(name)?;
                if set[..k].contains(name) {
                    return Err(Error::input(
                        format!("sets[{i}]"),
                        format!("{name} twice"),
                        "each effect once",
                    ));
                }
            }
        }
        for (i, (mean, sd)) in self.prior.iter().enumerate() {
            crate::error::within(&format!("prior[{i}][0]"), *mean, -1e6, 1e6)?;
            crate::error::within(&format!("prior[{i}][1]"), *sd, 1e-9, 1e6)?;
        }
        match &self.sampler {
            Sampler::Smc(config) => config.validate().map_err(|e| e.under("sampler")),
            Sampler::Mcmc(config) => config.validate().map_err(|e| e.under("sampler")),
        }
    }
}

/// Draws what is known of a scene's latents (those it has to `calibrate`) and of the parameters of effects.
pub fn posterior(
    scene: &Scene,
    trials: &[Trial],
    config: &PosteriorConfig,
    progress: &dyn Progress,
) -> Result<Posterior> {
    with_models(scene, trials, config, progress, |models, ready| {
        let mut sets = Vec::with_capacity(models.len());
        let mut noise = f64::INFINITY;
        for Weighed { model, weight, predictive } in models {
            let own = Ask { model, ready, config };
            let (density, numbers, reference, fit) = own.likelihood()?;
            let draws = match &config.sampler {
                Sampler::Smc(own) => smc(&density, &reference, own, progress)?,
                Sampler::Mcmc(own) => mcmc(&density, &reference, own, progress)?,
            };
            noise = noise.min(model.noise.sd);
            sets.push(OfSet {
                set: model.layout.terms.iter().map(|t| t.effect.name.to_string()).collect(),
                numbers,
                fit,
                fields: density.fields(&draws.points)?,
                draws,
                weight: *weight,
                predictive: *predictive,
                sizes: density.sizes(),
            });
        }
        Ok(Posterior { sets, trials: [ready.kept.len(), trials.len()], noise })
    })
}

/// The likelihood of a single set's model, with what each number of a point is and where the fit stood: for samplers of one's own.
pub fn likelihood(
    scene: &Scene,
    trials: &[Trial],
    config: &PosteriorConfig,
    progress: &dyn Progress,
) -> Result<(Density, Vec<Known>, Vec<f64>)> {
    if config.sets.len() != 1 {
        return Err(Error::input("sets", format!("{} sets", config.sets.len()), "one set of effects"));
    }
    with_models(scene, trials, config, progress, |models, ready| {
        let (density, numbers, _, fit) = Ask { model: &models[0].model, ready, config }.likelihood()?;
        Ok((density, numbers, fit))
    })
}

/// What a set's model is fitted to, and where its fit stands.
pub struct OfModel {
    windows: Vec<Window>,
    /// Scale of the residuals by window, m.
    sd: Vec<f64>,
    layout: Layout,
    state: State,
    noise: Noise,
}

/// A model, how much its set weighs among all, and how likely launches are, each told from the others.
struct Weighed {
    model: OfModel,
    weight: f64,
    predictive: f64,
}

/// Fits the model of every set and hands the models over.
fn with_models<T>(
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
    let grounds = Grounds {
        ready: &ready,
        whole: &ready.whole,
        observed: &opened.observed,
        engine: config.engine,
        seed: config.seed,
    };
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
            true => reached(&grounds, &fit)?,
            false => OfModel {
                windows: ready.windows.clone(),
                sd: opened.data.sd.clone(),
                layout: fit.layout.clone(),
                state: fit.state.clone(),
                noise: ready.noise,
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
struct Ask<'a> {
    model: &'a OfModel,
    ready: &'a Ready,
    config: &'a PosteriorConfig,
}

impl Ask<'_> {
    /// The likelihood, what its numbers are, where draws begin, and where the fit stands.
    fn likelihood(&self) -> Result<(Density, Vec<Known>, Reference, Vec<f64>)> {
        let OfModel { windows, sd, layout, state, noise } = self.model;
        let data = Data::new(windows, &self.ready.settings, sd.clone(), self.config.engine);
        let fitter = Fitter::new(&data, noise);
        let fit = fitter.refined(layout.clone(), state.clone())?;
        let fit =
            fit.ok_or_else(|| Error::Failed("the model could not be scored where its fit stands".into()))?;
        let (density, numbers) = ready_to_draw(&fitter, &fit, self.ready, self.config)?;
        let reference = reference(&fit, &density);
        Ok((density, numbers, reference, fit.state.values))
    }
}

/// The likelihood of a fitted model, and what its numbers are.
fn ready_to_draw(
    fitter: &Fitter,
    fit: &Fitted,
    ready: &Ready,
    config: &PosteriorConfig,
) -> Result<(Density, Vec<Known>)> {
    let numbers = known(&fit.layout, &ready.names, &config.prior);
    let prior = prior::of(&numbers)?;
    let (extras, kinds) = match config.discrepancy {
        true => functions(fitter, &fit.layout, &fit.state)?,
        false => (Vec::new(), Vec::new()),
    };
    let density = Density::new(fitter, fit, prior, &extras, &kinds)?;
    let failed = || Error::Failed("the windows cannot be simulated where the fit stands".into());
    Ok((density.ok_or_else(failed)?, numbers))
}

/// Where draws begin.
fn reference(fit: &Fitted, density: &Density) -> Reference {
    use crate::estimate::sampler::Target as _;
    let prior = density.prior();
    let inside = |(v, m): (&f64, &crate::estimate::sampler::Marginal)| {
        let [low, high] = m.bounds();
        v.clamp(low, high)
    };
    let at: Vec<f64> = fit.state.values.iter().zip(prior.marginals()).map(inside).collect();
    let mut covariance = fit.covariance.clone();
    for i in 0..at.len() {
        // Launches that disagree know less than each of them claims.
        let share = (fit.robust[i] / covariance[(i, i)]).max(1.0);
        if share.is_finite() {
            covariance.row_mut(i).scale_mut(share.sqrt());
            covariance.column_mut(i).scale_mut(share.sqrt());
        }
    }
    Reference::new(&at, &covariance, WIDER, prior)
}

/// Functions of a shared field where windows were, and which of them are a field of each kind.
fn functions(fitter: &Fitter, layout: &Layout, state: &State) -> Result<(Vec<Extra>, Kinds)> {
    let paths = paths(fitter.data, layout, state)?;
    let of = |(effect, values): &(&'static Effect, Vec<f64>)| {
        [0, 1].map(|k| {
            let mut values = values.clone();
            values[k] = SLIGHT;
            Extra { effect, values, unit: SLIGHT }
        })
    };
    let functions = field::functions(fitter.data.windows, &paths);
    let extras = functions.effects().iter().flat_map(of).collect();
    Ok((extras, OVERS.map(|over| (over, functions.range(over))).to_vec()))
}
