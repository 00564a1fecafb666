//! Report of an estimation.

use serde::{Deserialize, Serialize};

use super::config::EstimateConfig;
use super::selection_summary::SelectionSummary;
use crate::error::Result;
use crate::estimate::LatentEstimate;
use crate::inference::{DiagnosisConfig, FitQuality, check_fit};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::scene::EffectTerm;
use crate::world::ParameterVector;

/// Report of an estimation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimateReport {
    /// Latents, in the order of `world::latent::FACTORS`.
    pub latents: Vec<LatentEstimate>,
    /// Residual of the best sample of each round, m^2 per trajectory.
    pub residuals: Vec<f64>,
    /// Fitted effect parameters; empty if none was requested.
    pub effects: Vec<LatentEstimate>,
    /// Estimate after each round: density (kg/m^2), friction, restitution, c of `linear_drag` (1/s; 0 if it is not fitted), then
    /// the other fitted parameters in the order of `config.cem.fit`.
    pub estimates: Vec<ParameterVector>,
    /// Summary of each round's selection.
    pub choices: Vec<SelectionSummary>,
    /// Real interactions (valid attempts) used.
    pub real_interactions: u64,
    /// Rollouts simulated.
    pub rollouts: u64,
    /// Whether the simulation, with the fitted effects, can reproduce the trials; absent if it was not checked.
    #[serde(default)]
    pub fit: Option<FitQuality>,
    /// Reason for stopping.
    pub stopped: StopReason,
    /// Wall-clock time, s; set by the caller.
    pub seconds: Option<f64>,
    pub strategy: String,
    pub seed: u64,
    pub config: EstimateConfig,
    /// Version of the program.
    pub version: String,
}

/// Reason why an estimation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// All rounds are complete.
    Rounds,
    /// The estimate converged.
    Settled,
    /// The budget of real interactions is spent.
    Budget,
    /// Not ended: more rounds are possible.
    Unfinished,
}

impl EstimateReport {
    /// Checks whether the simulation, with the fitted effects, can reproduce the trials of the estimation.
    pub fn check_fit(&mut self, trials: &[Trial], progress: &dyn Progress) -> Result<()> {
        let config = DiagnosisConfig { engine: self.config.engine, ..DiagnosisConfig::standard(self.seed) };
        let mut effects = self.config.effects.clone();
        for fitted in self.extension() {
            effects.retain(|own| own.name != fitted.name);
            effects.push(fitted);
        }
        self.fit = Some(check_fit(trials, &effects, &config, progress)?);
        Ok(())
    }

    /// Whether the simulation cannot reproduce the trials, so that the intervals are too narrow.
    pub fn has_bad_fit(&self) -> bool {
        self.fit.as_ref().is_some_and(|fit| fit.adequate == Some(false))
    }

    /// The point estimate of the latents.
    pub fn values(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.latents[i].value)
    }

    /// The fitted effects, as terms for a simulation.
    pub fn extension(&self) -> Vec<EffectTerm> {
        let mut terms: Vec<EffectTerm> = Vec::new();
        for (parameter, estimate) in self.config.cem.free_parameters().iter().zip(&self.effects) {
            let has_name = |term: &&EffectTerm| term.name == parameter.effect.name;
            if !terms.iter().any(|term| has_name(&term)) {
                terms.extend(self.config.effects.iter().find(has_name).cloned());
            }
            EffectTerm::set_in(&mut terms, parameter.effect.name, parameter.parameter().name, estimate.value);
        }
        terms
    }
}
