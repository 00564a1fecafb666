//! Estimators behind one interface: each returns equally weighted parameter samples for the same trials.
//!
//! | estimator | result |
//! |---|---|
//! | `posterior` | posterior draws by sequential Monte Carlo: [`crate::inference::posterior`] |
//! | `galileo` | posterior draws by Markov chain Monte Carlo with the same likelihood (Wu et al. 2015) |
//! | `iplw` | refined point estimate of the cross-entropy method (Semage et al.), as `iplw estimate` reports it |
//! | `tunenet` | point estimate after learned update steps (Allevato et al. 2019) |
//!
//! All share the prior of the latents. For an effect's parameter, the first two use a prior scaled to its plausible size; the last two
//! use the weak prior of `iplw estimate` (`world::effect::ParameterDeclaration::weak_prior`).

use serde::{Deserialize, Serialize};

use super::config::EstimateConfig;
use super::fit::{fit_round, simulation};
use crate::error::{Error, Result};
use crate::estimate::sampler::mcmc::McmcConfig;
use crate::estimate::sampler::smc::SmcConfig;
use crate::estimate::tunenet::{TuneNetConfig, tune};
use crate::estimate::{Cem, ParameterSample, ParameterSamples};
use crate::inference::posterior::{PosteriorConfig, PosteriorDocument, Sampler, posterior};
use crate::names::names;
use crate::progress::Progress;
use crate::reality::{Trial, with_trial_settings};
use crate::task::Scene;
use crate::world::{EffectParameter, Engine, ParameterVector, effect};

/// Estimation method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    #[default]
    Posterior,
    Galileo,
    Iplw,
    Tunenet,
}

/// Rounds of the cross-entropy method.
const ROUNDS: usize = 3;

names!(Estimator: Posterior = "posterior", Galileo = "galileo", Iplw = "iplw", Tunenet = "tunenet");

impl Estimator {
    /// Whether the estimator returns posterior draws; if not, a point estimate.
    pub fn draws(self) -> bool {
        matches!(self, Estimator::Posterior | Estimator::Galileo)
    }

    /// The estimator called `name`.
    pub fn from_name(name: &str) -> Result<Estimator> {
        let known = Estimator::ALL.map(Estimator::name);
        Estimator::named(name).ok_or_else(|| Error::not_found("estimator", name, known))
    }
}

/// Input of an estimator.
pub struct EstimatorInput<'a> {
    /// Prior mean and standard deviation of each latent.
    pub prior: [(f64, f64); 3],
    /// Scene from which the trials' scenes differ only in their settings.
    pub base: &'a Scene,
    /// Effects whose parameters are estimated in addition to the latents.
    pub set: &'a [String],
    /// Engine of the simulation.
    pub engine: Engine,
    /// Number of draws, for samplers.
    pub draws: usize,
    /// Standard deviation of the measurement noise, m.
    pub noise: f64,
    pub seed: u64,
}

/// Result of an estimator.
pub struct EstimatorOutput {
    /// Name, mean and, if available, standard deviation of each parameter.
    pub numbers: Vec<(String, f64, Option<f64>)>,
    /// Whether the sampler converged; always true for a point estimate.
    pub converged: bool,
    pub draws: Vec<ParameterSample>,
}

impl EstimatorInput<'_> {
    /// Runs an estimator on trials.
    pub fn estimate(
        &self,
        by: Estimator,
        trials: &[Trial],
        progress: &dyn Progress,
    ) -> Result<EstimatorOutput> {
        match by {
            Estimator::Posterior => {
                let usual = SmcConfig::standard(self.seed);
                let sampler = SmcConfig { particles: self.draws.div_ceil(usual.runs), ..usual };
                self.sample_posterior(Sampler::Smc(sampler), trials, progress)
            }
            Estimator::Galileo => {
                let mut told =
                    self.sample_posterior(Sampler::Mcmc(McmcConfig::standard(self.seed)), trials, progress)?;
                let (kept, all) = (self.draws.min(told.draws.len()), told.draws.len());
                told.draws = (0..kept).map(|i| told.draws[i * all / kept].clone()).collect();
                Ok(told)
            }
            Estimator::Iplw => self.search_latents(trials, progress),
            Estimator::Tunenet => self.tune_latents(trials, progress),
        }
    }

    fn sample_posterior(
        &self,
        sampler: Sampler,
        trials: &[Trial],
        progress: &dyn Progress,
    ) -> Result<EstimatorOutput> {
        let (scene, trials) = with_trial_settings(self.base, trials.to_vec())?;
        let config = PosteriorConfig {
            sets: vec![self.set.to_vec()],
            prior: self.prior,
            engine: self.engine,
            sampler,
            ..PosteriorConfig::standard(self.seed)
        };
        let document = PosteriorDocument::new(&posterior(&scene, &trials, &config, progress)?, &config);
        let numbers = document.parameters.iter().map(|p| (p.name.clone(), p.mean, Some(p.sd))).collect();
        let value = serde_json::to_value(&document).map_err(|e| Error::Failed(e.to_string()))?;
        let draws = ParameterSamples::from_value(value)?.draws().to_vec();
        Ok(EstimatorOutput { numbers, converged: document.converged, draws })
    }

    /// The configuration that `iplw estimate` uses.
    fn config(&self) -> Result<EstimateConfig> {
        let usual = EstimateConfig::fast(self.prior);
        let mut config = EstimateConfig { seed: self.seed, engine: self.engine, ..usual };
        parameters(self.set)?.into_iter().for_each(|own| config.cem.add_free_parameter(own));
        Ok(config)
    }

    fn search_latents(&self, trials: &[Trial], progress: &dyn Progress) -> Result<EstimatorOutput> {
        let config = self.config()?;
        let mut cem = Cem::new(config.cem.clone())?;
        let mut found: Option<ParameterVector> = None;
        for round in 0..ROUNDS {
            found = fit_round(&mut cem, found.as_ref(), trials, &config, round, progress)?.refined;
        }
        self.point(&config, &found.unwrap_or_else(|| cem.estimate()))
    }

    fn tune_latents(&self, trials: &[Trial], progress: &dyn Progress) -> Result<EstimatorOutput> {
        let config = self.config()?;
        let coordinates = config.cem.coordinates();
        let own = TuneNetConfig::standard(self.noise, self.seed);
        let told = tune(trials, &config.cem.start(), simulation(&config, &coordinates), &own, progress)?;
        self.point(&config, &told.estimate)
    }

    fn point(&self, config: &EstimateConfig, at: &[f64]) -> Result<EstimatorOutput> {
        let coordinates = config.cem.coordinates();
        let open = config.cem.prior_sd();
        let numbers = (0..at.len()).filter(|i| open[*i] > 0.0).map(|i| (coordinates.name(i), at[i], None));
        let belief =
            ParameterSamples::point(coordinates.latents(at), coordinates.effects(at, &config.effects))?;
        Ok(EstimatorOutput { numbers: numbers.collect(), converged: true, draws: belief.draws().to_vec() })
    }
}

/// All parameters of a set of effects.
pub(super) fn parameters(set: &[String]) -> Result<Vec<EffectParameter>> {
    let mut all = Vec::new();
    for name in set {
        let effect = effect::find(name)?;
        all.extend((0..effect.parameters.len()).map(|index| EffectParameter { effect, index }));
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::random_trials;
    use crate::progress::NoProgress;
    use crate::reality::{HiddenConfig, HiddenWorld, standard};
    use crate::task::{Split, family, split};

    /// Each recovers the drag from the same trials within 0.02 1/s; `tunenet` within 0.1 1/s.
    #[test]
    fn each_estimator_recovers_drag() {
        let family = family("basketball").unwrap();
        let usual = standard(family);
        let hidden = HiddenConfig { noise: 0.005, seed: 5, ..usual };
        let tasks = split(&family.fold(0), Split::Train);
        let trials =
            random_trials(&tasks, &mut HiddenWorld::new(hidden).unwrap(), 6, 5, &NoProgress).unwrap();
        let set = ["linear_drag".to_string()];
        let asked = EstimatorInput {
            prior: family.prior,
            base: &tasks[0].scene,
            set: &set,
            engine: Engine::Auto,
            draws: 64,
            noise: 0.005,
            seed: 5,
        };
        for by in Estimator::ALL {
            let name = by.name();
            let told = asked.estimate(by, &trials, &NoProgress).unwrap();
            let of = |wanted: &str| told.numbers.iter().find(|n| n.0 == wanted).unwrap();
            let (drag, within) = (of("linear_drag.c"), if name == "tunenet" { 0.1 } else { 0.02 });
            assert!((drag.1 + libm::log(0.8)).abs() < within, "{name}: {drag:?}");
            let drawn = by.draws();
            assert_eq!((told.draws.len(), drag.2.is_some()), (if drawn { 64 } else { 1 }, drawn), "{name}");
            assert!(told.draws[0].value("linear_drag.c").is_some(), "{name}");
            assert_eq!(Estimator::from_name(name).unwrap(), by);
        }
        assert!(Estimator::from_name("oracle").unwrap_err().to_string().contains("tunenet"));
    }
}
