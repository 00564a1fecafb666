//! What an estimation found.

use serde::{Deserialize, Serialize};

use super::choice::Choice;
use super::config::EstimateConfig;
use crate::estimate::LatentEstimate;
use crate::task::scene::EffectTerm;
use crate::world::Sample;

/// What an estimation found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimateReport {
    /// In the order of `world::latent::FACTORS`.
    pub latents: Vec<LatentEstimate>,
    /// Residual of the best sample of each round, m^2 per trajectory.
    pub residuals: Vec<f64>,
    /// Effects fitted along with the latents; empty unless asked for.
    pub effects: Vec<LatentEstimate>,
    /// Estimate after each round: density (kg/m^2), friction, restitution, c of `linear_drag` (1/s), 0 where it is not
    /// fitted, then what else is fitted along, in the order of `config.cem.fit`.
    pub estimates: Vec<Sample>,
    /// What the strategy chose in each round.
    pub choices: Vec<Choice>,
    /// Valid attempts this estimation cost in the real world.
    pub real_interactions: u64,
    /// Rollouts simulated.
    pub rollouts: u64,
    /// Why it ended.
    pub stopped: Stopped,
    /// Wall-clock seconds; filled in by whoever has a clock.
    pub seconds: Option<f64>,
    pub strategy: String,
    pub seed: u64,
    pub config: EstimateConfig,
    /// Version of this program.
    pub version: String,
}

/// Why an estimation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stopped {
    /// All rounds were run.
    Rounds,
    /// The estimate no longer moved.
    Settled,
    /// The real world's budget was spent.
    Budget,
    /// It has not: more could be measured.
    Unfinished,
}

impl EstimateReport {
    /// The point estimate of the latents.
    pub fn values(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.latents[i].value)
    }

    /// The effects that were fitted along, as a simulation takes them.
    pub fn extension(&self) -> Vec<EffectTerm> {
        let mut terms: Vec<EffectTerm> = Vec::new();
        for (own, found) in self.config.cem.fitted().iter().zip(&self.effects) {
            let given = self.config.effects.iter().find(|term| term.name == own.effect.name);
            let known = terms.iter().position(|term| term.name == own.effect.name);
            let at = known.unwrap_or_else(|| {
                let bare = || EffectTerm { name: own.effect.name.into(), parameters: Default::default() };
                terms.push(given.cloned().unwrap_or_else(bare));
                terms.len() - 1
            });
            terms[at].parameters.insert(own.parameter().name.into(), found.value);
        }
        terms
    }
}
