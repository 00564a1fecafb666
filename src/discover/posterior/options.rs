//! User-facing options of a posterior, and their translation into a configuration.

use std::collections::BTreeMap;

use super::{PosteriorConfig, Sampler};
use crate::error::{Error, Result, check_range};
use crate::estimate::sampler::mcmc::McmcConfig;
use crate::estimate::sampler::smc::SmcConfig;
use crate::world::Engine;
use crate::world::latent::factor_index;

/// Options; unset ones have defaults.
#[derive(Clone, Debug, Default)]
pub struct PosteriorOptions {
    /// Sets of effects by name; the scene without further effects if empty.
    pub sets: Vec<Vec<String>>,
    /// Prior mean and standard deviation by latent; overrides the default.
    pub prior: BTreeMap<String, [f64; 2]>,
    /// `smc` or `mcmc`.
    pub method: Option<String>,
    /// Total number of draws.
    pub draws: Option<usize>,
    pub discrepancy: Option<bool>,
    /// Whether the discrepancy field is sampled as part of the model.
    pub sample_discrepancy: bool,
    pub engine: Engine,
    pub seed: u64,
}

/// Minimum and maximum number of draws.
const DRAW_LIMITS: [f64; 2] = [64.0, 100_000.0];
/// Default total number of draws.
const DEFAULT_DRAWS: usize = 1024;

impl PosteriorOptions {
    /// Builds the configuration. Errors name the invalid field.
    pub fn config(&self) -> Result<PosteriorConfig> {
        let usual = PosteriorConfig::standard(self.seed);
        let mut prior = usual.prior;
        for (name, [mean, sd]) in &self.prior {
            prior[factor_index(name)?] = (*mean, *sd);
        }
        let draws = self.draws.unwrap_or(DEFAULT_DRAWS);
        check_range("draws", draws as f64, DRAW_LIMITS[0], DRAW_LIMITS[1])?;
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
            sample_discrepancy: self.sample_discrepancy,
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
    fn unset_options_have_defaults() {
        assert_eq!(PosteriorOptions::default().config().unwrap(), PosteriorConfig::standard(0));
        let prior = [("friction".to_string(), [0.3, 0.1])].into();
        let wanted = PosteriorOptions {
            prior,
            draws: Some(100),
            method: Some("mcmc".into()),
            ..PosteriorOptions::default()
        };
        let config = wanted.config().unwrap();
        assert_eq!(config.prior[factor_index("friction").unwrap()], (0.3, 0.1));
        assert!(matches!(config.sampler, Sampler::Mcmc(McmcConfig { steps: 8, .. })), "{:?}", config.sampler);
    }

    #[test]
    fn rejects_invalid_options_by_name() {
        let refused = |wanted: PosteriorOptions, name: &str| {
            let error = wanted.config().unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        refused(PosteriorOptions { method: Some("hmc".into()), ..PosteriorOptions::default() }, "method");
        refused(PosteriorOptions { draws: Some(3), ..PosteriorOptions::default() }, "draws");
        refused(
            PosteriorOptions { sets: vec![vec!["ether".into()]], ..PosteriorOptions::default() },
            "ether",
        );
        refused(
            PosteriorOptions { sets: vec![vec!["wind".into(); 2]], ..PosteriorOptions::default() },
            "sets[0]",
        );
        refused(
            PosteriorOptions {
                prior: [("grip".to_string(), [1.0, 1.0])].into(),
                ..PosteriorOptions::default()
            },
            "grip",
        );
        refused(
            PosteriorOptions {
                prior: [("friction".to_string(), [1.0, 0.0])].into(),
                ..PosteriorOptions::default()
            },
            "prior",
        );
    }
}
