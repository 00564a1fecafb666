//! Configuration and result of a diagnosis.

use crate::inference::report::Diagnosis;
use crate::inference::report::evidence::Evidence;
use crate::task::Scene;
use crate::world::Engine;

/// Configuration of a diagnosis.
#[derive(Clone, Debug)]
pub struct DiagnosisConfig {
    /// Seed of the bootstrap over trials and of global searches.
    pub seed: u64,
    /// Maximum number of effects in a set.
    pub max_effects: usize,
    /// Physics engine.
    pub engine: Engine,
}

impl DiagnosisConfig {
    /// Defaults of `iplw diagnose`.
    pub fn standard(seed: u64) -> DiagnosisConfig {
        DiagnosisConfig { seed, max_effects: 3, engine: Engine::Auto }
    }
}

/// A diagnosis with the extended scene and its evidence.
pub struct DiagnosisResult {
    pub diagnosis: Diagnosis,
    /// The scene with the selected effects and estimated latents, ready for rollouts.
    pub extended: Scene,
    pub evidence: Evidence,
}
