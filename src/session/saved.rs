//! Stored configuration of a world, from which it is restored after a restart.

use serde::{Deserialize, Serialize};

use super::catalogue::{Catalogue, TaskSet};
use super::config::{WorldConfig, WorldKind};
use crate::error::Result;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::{Engine, Latents};

/// [`WorldConfig`] as plain data: tasks by name, or the user's scene. Contains the hidden latents of a real world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SavedWorld {
    /// A family or one of its tasks; `None` for a custom scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub task: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<Scene>,
    pub kind: WorldKind,
    pub engine: Engine,
    pub latents: Latents,
    pub effects: Option<Vec<EffectTerm>>,
    pub noise: f64,
    pub budget: Option<u64>,
    #[serde(default = "one_attempt")]
    pub max_attempts: u32,
    pub sealed: Option<bool>,
    pub seed: u64,
}

impl SavedWorld {
    /// Converts a configuration for storage.
    pub fn of(config: &WorldConfig) -> SavedWorld {
        let custom = config.tasks.family.is_none();
        SavedWorld {
            task: (!custom).then(|| config.tasks.name.clone()),
            scene: custom.then(|| config.tasks.tasks[0].scene.clone()),
            kind: config.kind,
            engine: config.engine,
            latents: config.latents,
            effects: config.effects.clone(),
            noise: config.noise,
            budget: config.budget,
            max_attempts: config.max_attempts,
            sealed: config.sealed,
            seed: config.seed,
        }
    }

    /// Converts it back.
    pub fn config(self, catalogue: &Catalogue) -> Result<WorldConfig> {
        let tasks = match self.scene {
            Some(scene) => TaskSet::explorable(scene)?,
            None => catalogue.named(self.task.as_deref().unwrap_or_default())?,
        };
        Ok(WorldConfig {
            tasks,
            kind: self.kind,
            engine: self.engine,
            latents: self.latents,
            effects: self.effects,
            noise: self.noise,
            budget: self.budget,
            max_attempts: self.max_attempts,
            sealed: self.sealed,
            seed: self.seed,
        })
    }
}

/// Of worlds that were stored without a number.
fn one_attempt() -> u32 {
    1
}
