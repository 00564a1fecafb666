//! Estimators side by side: what each makes of the same trials, as equally likely worlds.
//!
//! | estimator | what is known by it |
//! |---|---|
//! | `posterior` | draws by sequential Monte Carlo, as [`crate::discover::posterior`] has them |
//! | `galileo` | draws by Markov chains from the same likelihood (Wu et al. 2015) |
//! | `iplw` | the point that the cross-entropy method ends at, refined (Semage et al.), as `iplw estimate` has it |
//! | `tunenet` | the point that learned steps lead to (Allevato et al. 2019) |
//!
//! All believe the same of latents beforehand. Of an effect's parameter the first two believe that it is as large as is plausible or
//! less; the last two start where `iplw estimate` does (`world::effect::Parameter::prior`).

use serde::{Deserialize, Serialize};

use super::config::EstimateConfig;
use super::fit::{fit_round, simulation};
use crate::discover::posterior::{Document, PosteriorConfig, Sampler, posterior};
use crate::error::{Error, Result};
use crate::estimate::sampler::mcmc::McmcConfig;
use crate::estimate::sampler::smc::SmcConfig;
use crate::estimate::tunenet::{TuneNetConfig, tune};
use crate::estimate::{Belief, Believed, Cem};
use crate::progress::Progress;
use crate::reality::{Trial, settled};
use crate::task::Scene;
use crate::world::{EffectParameter, Engine, Sample, effect};

/// Which method reads the trials.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    #[default]
    Posterior,
    Galileo,
    Iplw,
    Tunenet,
}

/// All of them, by name.
pub const ESTIMATORS: [(&str, Estimator); 4] = [
    ("posterior", Estimator::Posterior),
    ("galileo", Estimator::Galileo),
    ("iplw", Estimator::Iplw),
    ("tunenet", Estimator::Tunenet),
];

/// Rounds in which the cross-entropy method looks at the trials again.
const ROUNDS: usize = 3;

impl Estimator {
    /// The name that the command line has for it.
    pub fn name(self) -> &'static str {
        ESTIMATORS.iter().find(|(_, own)| *own == self).map_or("posterior", |(name, _)| name)
    }

    /// Whether it says how sure it is, by draws; a point otherwise.
    pub fn draws(self) -> bool {
        matches!(self, Estimator::Posterior | Estimator::Galileo)
    }

    /// By its name.
    pub fn from_name(name: &str) -> Result<Estimator> {
        ESTIMATORS.iter().find(|(own, _)| *own == name).map(|(_, e)| *e).ok_or_else(|| Error::NotFound {
            kind: "estimator",
            id: name.to_string(),
            known: ESTIMATORS.iter().map(|(name, _)| name.to_string()).collect(),
        })
    }
}

/// What is asked of an estimator.
pub struct Asked<'a> {
    /// What is believed of the latents: mean and standard deviation of each.
    pub prior: [(f64, f64); 3],
    /// The scene of which trials' scenes are settings.
    pub base: &'a Scene,
    /// Effects whose parameters are to be known beside the latents.
    pub set: &'a [String],
    /// Engine of the simulation.
    pub engine: Engine,
    /// Draws of those that draw.
    pub draws: usize,
    /// Standard deviation of what is seen, m.
    pub noise: f64,
    pub seed: u64,
}

/// What trials tell.
pub struct Told {
    /// Name, mean, and standard deviation where the estimator has one.
    pub numbers: Vec<(String, f64, Option<f64>)>,
    /// Whether draws can be trusted; always true of a point.
    pub converged: bool,
    pub draws: Vec<Believed>,
}

impl Asked<'_> {
    /// What an estimator makes of trials.
    pub fn told(&self, by: Estimator, trials: &[Trial], progress: &dyn Progress) -> Result<Told> {
        match by {
            Estimator::Posterior => {
                let usual = SmcConfig::standard(self.seed);
                let sampler = SmcConfig { particles: self.draws.div_ceil(usual.runs), ..usual };
                self.drawn(Sampler::Smc(sampler), trials, progress)
            }
            Estimator::Galileo => {
                let mut told =
                    self.drawn(Sampler::Mcmc(McmcConfig::standard(self.seed)), trials, progress)?;
                let (kept, all) = (self.draws.min(told.draws.len()), told.draws.len());
                told.draws = (0..kept).map(|i| told.draws[i * all / kept].clone()).collect();
                Ok(told)
            }
            Estimator::Iplw => self.searched(trials, progress),
            Estimator::Tunenet => self.tuned(trials, progress),
        }
    }

    fn drawn(&self, sampler: Sampler, trials: &[Trial], progress: &dyn Progress) -> Result<Told> {
        let (scene, trials) = settled(self.base, trials.to_vec())?;
        let config = PosteriorConfig {
            sets: vec![self.set.to_vec()],
            prior: self.prior,
            engine: self.engine,
            sampler,
            ..PosteriorConfig::standard(self.seed)
        };
        let document = Document::new(&posterior(&scene, &trials, &config, progress)?, &config);
        let numbers = document.parameters.iter().map(|p| (p.name.clone(), p.mean, Some(p.sd))).collect();
        let value = serde_json::to_value(&document).map_err(|e| Error::Failed(e.to_string()))?;
        let draws = Belief::from_value(value)?.draws().to_vec();
        Ok(Told { numbers, converged: document.converged, draws })
    }

    /// What is estimated, as `iplw estimate` does it.
    fn config(&self) -> Result<EstimateConfig> {
        let usual = EstimateConfig::fast(self.prior);
        let mut config = EstimateConfig { seed: self.seed, engine: self.engine, ..usual };
        parameters(self.set)?.into_iter().for_each(|own| config.cem.fit_along(own));
        Ok(config)
    }

    fn searched(&self, trials: &[Trial], progress: &dyn Progress) -> Result<Told> {
        let config = self.config()?;
        let mut cem = Cem::new(config.cem.clone())?;
        let mut found: Option<Sample> = None;
        for round in 0..ROUNDS {
            found = fit_round(&mut cem, found.as_ref(), trials, &config, round, progress)?.refined;
        }
        self.point(&config, &found.unwrap_or_else(|| cem.estimate()))
    }

    fn tuned(&self, trials: &[Trial], progress: &dyn Progress) -> Result<Told> {
        let config = self.config()?;
        let coordinates = config.cem.coordinates();
        let own = TuneNetConfig::standard(self.noise, self.seed);
        let told = tune(trials, &config.cem.start(), simulation(&config, &coordinates), &own, progress)?;
        self.point(&config, &told.estimate)
    }

    fn point(&self, config: &EstimateConfig, at: &[f64]) -> Result<Told> {
        let coordinates = config.cem.coordinates();
        let open = config.cem.deviations();
        let numbers = (0..at.len()).filter(|i| open[*i] > 0.0).map(|i| (coordinates.name(i), at[i], None));
        let belief = Belief::point(coordinates.latents(at), coordinates.effects(at, &config.effects))?;
        Ok(Told { numbers: numbers.collect(), converged: true, draws: belief.draws().to_vec() })
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
    use crate::progress::Silent;
    use crate::reality::{HiddenConfig, HiddenWorld, standard};
    use crate::task::{Split, family, split};

    /// Of the same trials each finds the drag, to 0.02 per second, by learned steps to 0.1.
    #[test]
    fn each_estimator_says_what_trials_tell() {
        let family = family("basketball").unwrap();
        let usual = standard(family);
        let hidden = HiddenConfig { noise: 0.005, seed: 5, ..usual };
        let tasks = split(&family.fold(0), Split::Train);
        let trials = random_trials(&tasks, &mut HiddenWorld::new(hidden).unwrap(), 6, 5, &Silent).unwrap();
        let set = ["linear_drag".to_string()];
        let asked = Asked {
            prior: family.prior,
            base: &tasks[0].scene,
            set: &set,
            engine: Engine::Auto,
            draws: 64,
            noise: 0.005,
            seed: 5,
        };
        for (name, by) in ESTIMATORS {
            let told = asked.told(by, &trials, &Silent).unwrap();
            let of = |wanted: &str| told.numbers.iter().find(|n| n.0 == wanted).unwrap();
            let (drag, within) = (of("linear_drag.c"), if name == "tunenet" { 0.1 } else { 0.02 });
            assert!((drag.1 + libm::log(0.8)).abs() < within, "{name}: {drag:?}");
            let drawn = by.draws();
            assert_eq!((told.draws.len(), drag.2.is_some()), (if drawn { 64 } else { 1 }, drawn), "{name}");
            assert!(told.draws[0].number("linear_drag.c").is_some(), "{name}");
            assert_eq!(Estimator::from_name(name).unwrap(), by);
        }
        assert!(Estimator::from_name("oracle").unwrap_err().to_string().contains("tunenet"));
    }
}
