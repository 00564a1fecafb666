//! Worlds: creation and description.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use super::physics::LatentsOut;
use super::space::{ActionSpaceOut, ObservationSpaceOut};
use crate::commands::{LatentsIn, effects, engine};
use crate::error::{Error, Result};
use crate::json::JsonObject;
use crate::session::{Catalogue, ListedWorld, TaskSet, WorldConfig, WorldDescription, WorldKind};
use crate::task::Scene;
use crate::task::scene::EffectTerm;

/// A world to create. Requires either `task` or `scene`.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateWorld {
    /// A family (`bowling`) or one task (`bowling:017`).
    pub task: Option<String>,
    /// An `iplw.scene/1` document with `action` and `goal`.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<JsonObject<Scene>>,
    /// Default: `sim`.
    pub kind: Option<WorldKind>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
    /// Latent factors. Default: the family's prior mean (sim) or standard true values (real).
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<JsonObject<LatentsIn>>,
    /// Effects beyond gravity and contact. Default without `damping`: none (sim) or the family's standard effects (real).
    #[schema(value_type = Option<Vec<EffectTerm>>)]
    pub effects: Option<Vec<JsonObject<EffectTerm>>>,
    /// Fraction of velocity kept per second, in (0, 1]; shorthand for the effect `linear_drag`.
    pub damping: Option<f64>,
    /// Standard deviation of observation noise, m; real worlds only.
    pub noise: Option<f64>,
    /// Maximum number of valid attempts; real worlds only.
    pub budget: Option<u64>,
    /// Maximum number of valid attempts in an episode. With more than one, an episode continues with the same task until it is solved
    /// (the reward is its AUCCESS, 1 at the first attempt) or all attempts have failed. Default: 1.
    pub max_attempts: Option<u32>,
    /// Whether latents and effects are hidden. Default: true for real, false for sim. False for a real world of a family only
    /// together with all `latents` and `effects`, since the family's own are hidden.
    pub sealed: Option<bool>,
    /// Seed of the task sequence, of noise, and of hidden numbers that a family draws from ranges.
    pub seed: Option<u64>,
}

/// A world.
#[derive(Serialize, ToSchema)]
pub struct WorldOut {
    pub id: String,
    /// Name of the token that created it; `null` for default worlds and without authentication.
    pub owner: Option<String>,
    /// Idle time, whole s. Listing and watching do not count as use.
    pub idle_s: u64,
    /// Family, task or custom scene.
    pub task: String,
    pub kind: WorldKind,
    pub engine: &'static str,
    pub sealed: bool,
    /// `null` if sealed, or if another client chose them for its real world.
    pub latents: Option<LatentsOut>,
    /// As `latents`.
    pub effects: Option<Vec<EffectTerm>>,
    /// Valid attempts so far: steps, rollouts, renders and jobs.
    pub interactions: u64,
    pub budget: Option<u64>,
    /// Maximum number of valid attempts in an episode.
    pub max_attempts: u32,
    /// Remaining budget.
    pub remaining: Option<u64>,
    pub seed: u64,
    pub action_space: ActionSpaceOut,
    pub observation_space: ObservationSpaceOut,
    pub state: EpisodeStateOut,
}

/// State of the current episode.
#[derive(Serialize, ToSchema)]
pub struct EpisodeStateOut {
    /// Id of the current task.
    pub task: Option<String>,
    /// `new`, `ready` or `done`.
    pub phase: &'static str,
    /// Resets so far.
    pub episodes: u64,
}

/// All worlds.
#[derive(Serialize, ToSchema)]
pub struct WorldsPage {
    pub worlds: Vec<WorldOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

impl CreateWorld {
    /// Converts the request.
    pub fn config(self, catalogue: &Catalogue) -> Result<WorldConfig> {
        let tasks = match (self.task, self.scene) {
            (Some(task), None) => catalogue.named(&task)?,
            (None, Some(scene)) => TaskSet::custom(scene.0).map_err(|e| e.in_field("scene"))?,
            (Some(_), Some(_)) => {
                return Err(Error::input("scene", "given together with `task`", "one of task and scene"));
            }
            (None, None) => return Err(Error::input("task", "missing", "one of task and scene")),
        };
        Ok(WorldConfig {
            tasks,
            kind: self.kind.unwrap_or(WorldKind::Sim),
            engine: engine(self.engine.as_deref())?,
            latents: self.latents.map(|o| o.0).unwrap_or_default().checked("latents.")?,
            effects: effects(self.damping, self.effects, "")?,
            noise: self.noise.unwrap_or(0.0),
            budget: self.budget,
            max_attempts: self.max_attempts.unwrap_or(1),
            sealed: self.sealed,
            seed: self.seed.unwrap_or(0),
        })
    }
}

impl WorldOut {
    /// From a listed world at time `now`, as described to the caller.
    pub fn of(listed: &ListedWorld, description: WorldDescription, now: Duration) -> WorldOut {
        let idle_s = now.saturating_sub(listed.used).as_secs();
        WorldOut { idle_s, ..WorldOut::new(&listed.id, listed.owner.as_deref(), description) }
    }

    /// From a world that is in use now.
    pub fn new(id: &str, owner: Option<&str>, d: WorldDescription) -> WorldOut {
        let features = d.features.len();
        WorldOut {
            id: id.into(),
            owner: owner.map(String::from),
            idle_s: 0,
            task: d.task,
            kind: d.kind,
            engine: d.engine.name(),
            sealed: d.sealed,
            latents: d.latents.map(LatentsOut::from),
            effects: d.effects,
            interactions: d.interactions,
            budget: d.budget,
            max_attempts: d.max_attempts,
            remaining: d.budget.map(|b| b.saturating_sub(d.interactions)),
            seed: d.seed,
            action_space: ActionSpaceOut::from(&d.actions),
            observation_space: ObservationSpaceOut {
                names: d.features,
                low: vec![0.0; features],
                high: vec![1.0; features],
            },
            state: EpisodeStateOut { task: d.current, phase: d.phase.name(), episodes: d.episodes },
        }
    }
}

impl BinaryArrays for WorldOut {}
impl BinaryArrays for WorldsPage {}
