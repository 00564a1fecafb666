//! What a design is to be.

use serde::{Deserialize, Serialize};

use super::costs::Costs;
use super::question::Question;
use crate::error::{Result, within};
use crate::world::Engine;

/// How the experiment that tells most is searched for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DesignConfig {
    /// What is to be told.
    pub question: Question,
    /// Random actions that are looked at.
    pub candidates: usize,
    /// So many of the best are looked at closely.
    pub shortlist: usize,
    /// Worlds of the first look, and of the close one.
    pub worlds: [usize; 2],
    /// Copies of an action whose spread counts as noise.
    pub copies: usize,
    /// Most that a component of an action is moved in a copy.
    pub perturb: f64,
    /// Standard deviation of an observed coordinate, m.
    pub noise: f64,
    /// Experiments to choose, together: each the one that adds most to those before it.
    pub batch: usize,
    /// What they cost.
    #[serde(default)]
    pub costs: Costs,
    pub engine: Engine,
    /// Decides the candidates, the draws, how copies are moved, and noise.
    pub seed: u64,
}

impl DesignConfig {
    /// 400 candidates in 32 worlds, the best 24 in 128; noise 5 mm.
    pub fn standard(question: Question, seed: u64) -> DesignConfig {
        DesignConfig {
            question,
            candidates: 400,
            shortlist: 24,
            worlds: [32, 128],
            copies: 4,
            perturb: crate::reality::certify::PERTURBATION,
            noise: 0.005,
            batch: 1,
            costs: Costs::default(),
            engine: Engine::Auto,
            seed,
        }
    }

    /// Errors unless everything is within what a design can be.
    pub fn validate(&self) -> Result<()> {
        within("candidates", self.candidates as f64, 1.0, 1e5)?;
        within("shortlist", self.shortlist as f64, 1.0, 1000.0)?;
        within("worlds[0]", self.worlds[0] as f64, 8.0, 1000.0)?;
        within("worlds[1]", self.worlds[1] as f64, 8.0, 1000.0)?;
        within("copies", self.copies as f64, 2.0, 32.0)?;
        within("perturb", self.perturb, 0.0, 1.0)?;
        within("noise", self.noise, 1e-6, 1e3)?;
        self.costs.validate()?;
        within("batch", self.batch as f64, 1.0, self.shortlist.min(self.candidates) as f64).map(drop)
    }
}
