//! What a diagnosis is asked for, and what it gives.

use super::evidence::Evidence;
use super::report::Diagnosis;
use crate::task::Scene;
use crate::world::Engine;

/// Knobs of a diagnosis.
#[derive(Clone, Debug)]
pub struct Config {
    /// Seed of the bootstrap over launches, and of the surveys of values where starts are known.
    pub seed: u64,
    /// Most effects in a set.
    pub most_effects: usize,
    /// Engine that simulates.
    pub engine: Engine,
}

impl Config {
    /// What `iplw diagnose` uses.
    pub fn standard(seed: u64) -> Config {
        Config { seed, most_effects: 3, engine: Engine::Auto }
    }
}

/// A diagnosis with what it was made from.
pub struct Finding {
    pub diagnosis: Diagnosis,
    /// The scene with the found effects and latents; it rolls out.
    pub extended: Scene,
    pub evidence: Evidence,
}
