//! What a world is made from, as plain data to be stored: a world that outlives its process is made from it again.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::catalogue::{Catalogue, TaskSet};
use super::config::{Kind, WorldConfig};
use super::world::{Account, World};
use crate::error::Result;
use crate::store::Store;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::{Engine, Latents};

/// [`WorldConfig`] with its tasks named (or, for a user's scene, written out). Holds what a real world hides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SavedWorld {
    /// A family or one of its tasks; else `scene`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub task: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<Scene>,
    pub kind: Kind,
    pub engine: Engine,
    pub latents: Latents,
    pub effects: Option<Vec<EffectTerm>>,
    pub noise: f64,
    pub budget: Option<u64>,
    pub sealed: Option<bool>,
    pub seed: u64,
}

impl SavedWorld {
    /// What `config` makes.
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
            sealed: config.sealed,
            seed: config.seed,
        }
    }

    /// The configuration again.
    pub fn config(self, catalogue: &Catalogue) -> Result<WorldConfig> {
        let tasks = match self.scene {
            Some(scene) => TaskSet::custom(scene)?,
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
            sealed: self.sealed,
            seed: self.seed,
        })
    }
}

impl World {
    /// The same world with `interactions` on its counter and, in a simulation, other latents.
    pub fn with_past(mut self, interactions: u64, latents: Option<Latents>) -> World {
        let state = self.state.get_mut().unwrap_or_else(std::sync::PoisonError::into_inner);
        state.interactions = interactions;
        if self.kind == Kind::Sim {
            state.latents = latents.unwrap_or_default().or(state.latents);
        }
        if let Some(hidden) = self.hidden.take() {
            let hidden = hidden.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
            self.hidden = Some(std::sync::Mutex::new(hidden.with_spent(interactions)));
        }
        self
    }

    /// The same world keeping its counter in the store as `id`.
    pub(super) fn kept_in(mut self, store: Arc<Store>, id: &str) -> World {
        self.account = Some(Account { store, id: id.into() });
        self
    }
}
