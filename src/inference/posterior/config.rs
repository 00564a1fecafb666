//! Configuration of posterior sampling.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, check_range};
use crate::estimate::sampler::mcmc::McmcConfig;
use crate::estimate::sampler::smc::SmcConfig;
use crate::world::Engine;
use crate::world::effect::validate_set;

/// Models, priors and sampler.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PosteriorConfig {
    /// Sets of effects by name, each a model; an empty set is the scene without further effects.
    pub sets: Vec<Vec<String>>,
    /// Prior mean and standard deviation of density, friction and restitution, truncated at their bounds.
    pub prior: [(f64, f64); 3],
    /// Whether shared model discrepancy is allowed for and integrated out.
    pub discrepancy: bool,
    /// Whether a likely discrepancy field becomes part of the model: simulated and sampled with the parameters.
    /// Takes minutes instead of seconds.
    #[serde(default, alias = "follow")]
    pub sample_discrepancy: bool,
    pub sampler: Sampler,
    pub engine: Engine,
    pub seed: u64,
}

/// Sampling method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Sampler {
    /// Sequential Monte Carlo.
    Smc(SmcConfig),
    /// Random-walk Metropolis, as in Galileo.
    Mcmc(McmcConfig),
}

impl PosteriorConfig {
    /// The scene without further effects, a thousand draws, the paper's prior.
    pub fn standard(seed: u64) -> PosteriorConfig {
        PosteriorConfig {
            sets: vec![Vec::new()],
            prior: [(1.0, 0.5), (1.0, 0.5), (0.5, 0.25)],
            discrepancy: true,
            sample_discrepancy: false,
            sampler: Sampler::Smc(SmcConfig::standard(seed)),
            engine: Engine::Auto,
            seed,
        }
    }

    /// Errors name the invalid field.
    pub fn validate(&self) -> Result<()> {
        if self.sets.is_empty() || self.sets.len() > 20 {
            return Err(Error::input("sets", format!("{} sets", self.sets.len()), "1 to 20 sets of effects"));
        }
        for (i, set) in self.sets.iter().enumerate() {
            validate_set(&format!("sets[{i}]"), set)?;
        }
        for (i, (mean, sd)) in self.prior.iter().enumerate() {
            check_range(&format!("prior[{i}][0]"), *mean, -1e6, 1e6)?;
            check_range(&format!("prior[{i}][1]"), *sd, 1e-9, 1e6)?;
        }
        if self.sample_discrepancy && !self.discrepancy {
            return Err(Error::input("sample_discrepancy", "true", "false if discrepancy is false"));
        }
        match &self.sampler {
            Sampler::Smc(config) => config.validate().map_err(|e| e.in_field("sampler")),
            Sampler::Mcmc(config) => config.validate().map_err(|e| e.in_field("sampler")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejects_invalid_config() {
        assert!(PosteriorConfig::standard(0).validate().is_ok());
        let refused = |config: PosteriorConfig, name: &str| {
            let error = config.validate().unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        let usual = || PosteriorConfig::standard(0);
        refused(PosteriorConfig { sets: Vec::new(), ..usual() }, "sets");
        refused(PosteriorConfig { sets: vec![vec!["wind".into(); 5]], ..usual() }, "sets[0]");
        refused(PosteriorConfig { prior: [(1.0, 0.5), (1.0, 0.5), (0.5, 0.0)], ..usual() }, "prior[2][1]");
        refused(
            PosteriorConfig { sample_discrepancy: true, discrepancy: false, ..usual() },
            "sample_discrepancy",
        );
        let sampler = Sampler::Smc(SmcConfig { runs: 1, ..SmcConfig::standard(0) });
        refused(PosteriorConfig { sampler, ..usual() }, "sampler.runs");
    }
}
