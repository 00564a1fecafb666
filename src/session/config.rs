//! Configuration of a world.

use serde::{Deserialize, Serialize};

use super::catalogue::TaskSet;
use crate::task::scene::EffectTerm;
use crate::world::{Engine, Latents};

/// Configuration of a world.
#[derive(Clone)]
pub struct WorldConfig {
    /// Tasks that can be attempted in it.
    pub tasks: TaskSet,
    /// Simulated or real.
    pub kind: WorldKind,
    /// Physics engine.
    pub engine: Engine,
    /// Latent factors. Default of a factor: the family's prior mean in a simulation, the family's standard true value in a
    /// real world, the scene's own coefficient for a custom scene.
    pub latents: Latents,
    /// Effects. Default: none in a simulation, the family's standard effects in a real world.
    pub effects: Option<Vec<EffectTerm>>,
    /// Standard deviation of observation noise, m; real worlds only.
    pub noise: f64,
    /// Maximum number of valid attempts; real worlds only.
    pub budget: Option<u64>,
    /// Whether latents and effects are hidden and cannot be set. Default: true for a real world.
    pub sealed: Option<bool>,
    /// Seed of the task sequence for unseeded resets, and of observation noise.
    pub seed: u64,
}

/// Whether a world is a simulation or stands in for the real world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WorldKind {
    Sim,
    Real,
}

impl WorldKind {
    /// The name used on the wire.
    pub fn name(self) -> &'static str {
        match self {
            WorldKind::Sim => "sim",
            WorldKind::Real => "real",
        }
    }
}
