//! Configuration of a world.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::catalogue::TaskSet;
use crate::names::names;
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
    /// Maximum number of valid attempts in an episode, from 1.
    pub max_attempts: u32,
    /// Whether latents and effects are hidden and cannot be set. Default: true for a real world; false there only with all
    /// latents and effects of one's own.
    pub sealed: Option<bool>,
    /// Seed of the task sequence for unseeded resets, of observation noise, and of hidden numbers that a family draws from
    /// ranges.
    pub seed: u64,
}

impl WorldConfig {
    /// A world with the default latents and effects, without noise and budget, seed 0.
    pub fn new(tasks: TaskSet, kind: WorldKind) -> WorldConfig {
        WorldConfig {
            tasks,
            kind,
            engine: Engine::Auto,
            latents: Latents::default(),
            effects: None,
            noise: 0.0,
            budget: None,
            max_attempts: 1,
            sealed: None,
            seed: 0,
        }
    }
}

/// Simulated or real.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
#[schema(as = WorldKindIn)]
pub enum WorldKind {
    Sim,
    Real,
}

names!(WorldKind: Sim = "sim", Real = "real");
