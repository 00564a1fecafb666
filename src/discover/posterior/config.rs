//! What a posterior is asked for.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, within};
use crate::estimate::sampler::mcmc::McmcConfig;
use crate::estimate::sampler::smc::SmcConfig;
use crate::world::Engine;
use crate::world::effect::check_set;

/// Sets of effects, beliefs, and how draws are made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PosteriorConfig {
    /// Sets of effects by name, each a model of its own; an empty set is the scene as it is.
    pub sets: Vec<Vec<String>>,
    /// Mean and standard deviation of density, friction and restitution as believed beforehand, cut off at their bounds.
    pub prior: [(f64, f64); 3],
    /// Whether what launches share and the model lacks may be there, and is integrated out.
    pub discrepancy: bool,
    /// Whether a field, where none is unlikely, is followed first: simulated, fitted with everything else, and integrated out about
    /// where that leads. Minutes instead of seconds.
    #[serde(default)]
    pub follow: bool,
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

impl PosteriorConfig {
    /// The scene as it is, a thousand draws, the paper's prior.
    pub fn standard(seed: u64) -> PosteriorConfig {
        PosteriorConfig {
            sets: vec![Vec::new()],
            prior: [(1.0, 0.5), (1.0, 0.5), (0.5, 0.25)],
            discrepancy: true,
            follow: false,
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
            check_set(&format!("sets[{i}]"), set)?;
        }
        for (i, (mean, sd)) in self.prior.iter().enumerate() {
            within(&format!("prior[{i}][0]"), *mean, -1e6, 1e6)?;
            within(&format!("prior[{i}][1]"), *sd, 1e-9, 1e6)?;
        }
        if self.follow && !self.discrepancy {
            return Err(Error::input(
                "follow",
                "true",
                "false where discrepancy is false: nothing may be lacking there",
            ));
        }
        match &self.sampler {
            Sampler::Smc(config) => config.validate().map_err(|e| e.under("sampler")),
            Sampler::Mcmc(config) => config.validate().map_err(|e| e.under("sampler")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_asked_is_refused() {
        assert!(PosteriorConfig::standard(0).validate().is_ok());
        let refused = |config: PosteriorConfig, name: &str| {
            let error = config.validate().unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        let usual = || PosteriorConfig::standard(0);
        refused(PosteriorConfig { sets: Vec::new(), ..usual() }, "sets");
        refused(PosteriorConfig { sets: vec![vec!["wind".into(); 5]], ..usual() }, "sets[0]");
        refused(PosteriorConfig { prior: [(1.0, 0.5), (1.0, 0.5), (0.5, 0.0)], ..usual() }, "prior[2][1]");
        refused(PosteriorConfig { follow: true, discrepancy: false, ..usual() }, "follow");
        let sampler = Sampler::Smc(SmcConfig { runs: 1, ..SmcConfig::standard(0) });
        refused(PosteriorConfig { sampler, ..usual() }, "sampler.runs");
    }
}
