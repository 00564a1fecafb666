//! Configuration of an experimental design.

use serde::{Deserialize, Serialize};

use super::costs::Costs;
use super::question::Question;
use crate::error::{Result, check_range};
use crate::world::Engine;

/// How the most informative experiment is searched for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DesignConfig {
    /// The question that the experiment is to answer.
    pub question: Question,
    /// Number of random candidate actions.
    pub candidates: usize,
    /// Number of best candidates that are evaluated again in more worlds.
    pub shortlist: usize,
    /// Worlds of the screening, and of the evaluation of the shortlist.
    pub worlds: [usize; 2],
    /// Perturbed copies of an action, whose spread counts as noise.
    pub copies: usize,
    /// Maximal perturbation of an action component in a copy.
    pub perturb: f64,
    /// Standard deviation of an observed coordinate, m.
    pub noise: f64,
    /// Experiments of the batch, chosen greedily: each adds most to the ones before it.
    pub batch: usize,
    /// Costs of experiments.
    #[serde(default)]
    pub costs: Costs,
    pub engine: Engine,
    /// Seed of the candidates, the draws, the perturbations and the noise.
    pub seed: u64,
}

impl DesignConfig {
    /// 400 candidates in 32 worlds, the best 24 of them in 128; noise of 5 mm.
    pub fn standard(question: Question, seed: u64) -> DesignConfig {
        DesignConfig {
            question,
            candidates: 400,
            shortlist: 24,
            worlds: [32, 128],
            copies: 4,
            perturb: crate::reality::certify::MAX_PERTURBATION,
            noise: 0.005,
            batch: 1,
            costs: Costs::default(),
            engine: Engine::Auto,
            seed,
        }
    }

    /// Errors unless every value is within its range.
    pub fn validate(&self) -> Result<()> {
        check_range("candidates", self.candidates as f64, 1.0, 1e5)?;
        check_range("shortlist", self.shortlist as f64, 1.0, 1000.0)?;
        check_range("worlds[0]", self.worlds[0] as f64, 8.0, 1000.0)?;
        check_range("worlds[1]", self.worlds[1] as f64, 8.0, 1000.0)?;
        check_range("copies", self.copies as f64, 2.0, 32.0)?;
        check_range("perturb", self.perturb, 0.0, 1.0)?;
        check_range("noise", self.noise, 1e-6, 1e3)?;
        self.costs.validate()?;
        check_range("batch", self.batch as f64, 1.0, self.shortlist.min(self.candidates) as f64).map(drop)
    }
}
