//! What people say of the posterior they want, as a configuration.

use std::collections::BTreeMap;

use super::{PosteriorConfig, Sampler};
use crate::error::{Error, Result, within};
use crate::estimate::sampler::mcmc::McmcConfig;
use crate::estimate::sampler::smc::SmcConfig;
use crate::world::Engine;
use crate::world::latent::factor_index;

/// What is said; what is not stays as usual.
#[derive(Clone, Debug, Default)]
pub struct Wanted {
    /// Sets of effects by name; the scene as it is, if there are none.
    pub sets: Vec<Vec<String>>,
    /// Mean and standard deviation by latent, over what is usual.
    pub prior: BTreeMap<String, [f64; 2]>,
    /// `smc` or `mcmc`.
    pub method: Option<String>,
    /// Draws in all.
    pub draws: Option<usize>,
    pub discrepancy: Option<bool>,
    /// Whether what the model lacks is followed.
    pub follow: bool,
    pub engine: Engine,
    pub seed: u64,
}

/// Fewest and most draws.
const DRAWS: [f64; 2] = [64.0, 100_000.0];
/// Draws in all, if none are said.
const USUAL: usize = 1024;

impl Wanted {
    /// Errors name the field that is wrong.
    pub fn config(&self) -> Result<PosteriorConfig> {
        let usual = PosteriorConfig::standard(self.seed);
        let mut prior = usual.prior;
        for (name, [mean, sd]) in &self.prior {
            prior[factor_index(name)?] = (*mean, *sd);
        }
        let draws = self.draws.unwrap_or(USUAL);
        within("draws", draws as f64, DRAWS[0], DRAWS[1])?;
        let sampler = match self.method.as_deref().unwrap_or("smc") {
            "smc" => {
                let own = SmcConfig::standard(self.seed);
                Sampler::Smc(SmcConfig { particles: draws.div_ceil(own.runs), ..own })
            }
            "mcmc" => {
                let own = McmcConfig::standard(self.seed);
                Sampler::Mcmc(McmcConfig { steps: draws.div_ceil(own.chains).max(8), ..own })
            }
            other => return Err(Error::input("method", format!("{other:?}"), "smc or mcmc")),
        };
        let config = PosteriorConfig {
            sets: if self.sets.is_empty() { usual.sets.clone() } else { self.sets.clone() },
            prior,
            discrepancy: self.discrepancy.unwrap_or(usual.discrepancy),
            follow: self.follow,
            sampler,
            engine: self.engine,
            ..usual
        };
        config.validate()?;
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_said_stays_as_usual() {
        assert_eq!(Wanted::default().config().unwrap(), PosteriorConfig::standard(0));
        let prior = [("friction".to_string(), [0.3, 0.1])].into();
        let wanted = Wanted { prior, draws: Some(100), method: Some("mcmc".into()), ..Wanted::default() };
        let config = wanted.config().unwrap();
        assert_eq!(config.prior[factor_index("friction").unwrap()], (0.3, 0.1));
        assert!(matches!(config.sampler, Sampler::Mcmc(McmcConfig { steps: 8, .. })), "{:?}", config.sampler);
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let refused = |wanted: Wanted, name: &str| {
            let error = wanted.config().unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        refused(Wanted { method: Some("hmc".into()), ..Wanted::default() }, "method");
        refused(Wanted { draws: Some(3), ..Wanted::default() }, "draws");
        refused(Wanted { sets: vec![vec!["ether".into()]], ..Wanted::default() }, "ether");
        refused(Wanted { sets: vec![vec!["wind".into(); 2]], ..Wanted::default() }, "sets[0]");
        refused(Wanted { prior: [("grip".to_string(), [1.0, 1.0])].into(), ..Wanted::default() }, "grip");
        refused(
            Wanted { prior: [("friction".to_string(), [1.0, 0.0])].into(), ..Wanted::default() },
            "prior",
        );
    }
}
