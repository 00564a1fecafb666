//! A world: what it is made from, and how it shows itself.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::bulk::Bulk;
use super::physics::{EffectIn, LatentsIn, LatentsOut, effects};
use super::space::{ActionSpaceOut, ObservationSpaceOut};
use super::strict::Object;
use crate::error::{Error, Result};
use crate::session::{Catalogue, Description, Kind, Listed, TaskSet, WorldConfig};
use crate::task::Scene;
use crate::world::Engine;

/// A world to make; one of `task` and `scene` is needed.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateWorld {
    /// A family (`bowling`) or one task (`bowling:017`).
    pub task: Option<String>,
    /// An `iplw.scene/1` document with `action` and `goal`.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Object<Scene>>,
    /// `sim` if absent.
    pub kind: Option<WorldKind>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
    /// Latent factors; those absent are the family's prior mean (sim) or its standard truth (real).
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<Object<LatentsIn>>,
    /// Effects beyond gravity and contact; a real world of a family has that family's if neither this nor
    /// `damping` is given.
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<Object<EffectIn>>>,
    /// Kept share of velocity per second, in (0, 1]; short for the effect `linear_drag`.
    pub damping: Option<f64>,
    /// Standard deviation of observation noise, m; real worlds only.
    pub noise: Option<f64>,
    /// Most valid attempts; real worlds only.
    pub budget: Option<u64>,
    /// Whether latents and effects are kept secret; default true for real, false for sim.
    pub sealed: Option<bool>,
    /// Seed of unseeded resets and of noise.
    pub seed: Option<u64>,
}

/// Simulated or real.
#[derive(Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum WorldKind {
    Sim,
    Real,
}

/// A world.
#[derive(Serialize, ToSchema)]
pub struct WorldOut {
    pub id: String,
    /// Name of the token it was made with; `null` for those that are always there, and where there are no tokens.
    pub owner: Option<String>,
    /// For how long nobody has used it, whole s. To list worlds or to watch one is no use.
    pub idle_s: u64,
    /// Family, task or custom scene.
    pub task: String,
    pub kind: WorldKind,
    pub engine: &'static str,
    pub sealed: bool,
    /// `null` if sealed.
    pub latents: Option<LatentsOut>,
    /// `null` if sealed.
    pub effects: Option<Vec<EffectIn>>,
    /// Valid attempts so far: steps, rollouts, films and jobs.
    pub interactions: u64,
    pub budget: Option<u64>,
    /// Budget not yet spent.
    pub remaining: Option<u64>,
    pub seed: u64,
    pub action_space: ActionSpaceOut,
    pub observation_space: ObservationSpaceOut,
    pub state: StateOut,
}

/// Where the current episode stands.
#[derive(Serialize, ToSchema)]
pub struct StateOut {
    /// Id of the current task.
    pub task: Option<String>,
    /// `new`, `ready` or `done`.
    pub phase: &'static str,
    /// Resets so far.
    pub episodes: u64,
}

/// All worlds.
#[derive(Serialize, ToSchema)]
pub struct Worlds {
    pub worlds: Vec<WorldOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

impl CreateWorld {
    /// The configuration asked for.
    pub fn config(self, catalogue: &Catalogue) -> Result<WorldConfig> {
        let tasks = match (self.task, self.scene) {
            (Some(task), None) => catalogue.named(&task)?,
            (None, Some(scene)) => TaskSet::custom(scene.0).map_err(|e| e.under("scene"))?,
            (Some(_), Some(_)) => {
                return Err(Error::input("scene", "given beside `task`", "one of task and scene"));
            }
            (None, None) => return Err(Error::input("task", "missing", "one of task and scene")),
        };
        Ok(WorldConfig {
            tasks,
            kind: self.kind.map_or(Kind::Sim, Kind::from),
            engine: engine(self.engine.as_deref())?,
            latents: self.latents.map(|o| o.0).unwrap_or_default().checked("latents.")?,
            effects: effects(self.damping, self.effects, "")?,
            noise: self.noise.unwrap_or(0.0),
            budget: self.budget,
            sealed: self.sealed,
            seed: self.seed.unwrap_or(0),
        })
    }
}

/// The engine named, or `auto`.
pub fn engine(name: Option<&str>) -> Result<Engine> {
    let Some(name) = name else { return Ok(Engine::Auto) };
    Engine::from_name(name).map_err(|e| match e {
        Error::NotFound { known, .. } => {
            Error::input("engine", format!("{name:?}"), format!("one of {}", known.join(", ")))
        }
        other => other,
    })
}

impl From<WorldKind> for Kind {
    fn from(kind: WorldKind) -> Kind {
        match kind {
            WorldKind::Sim => Kind::Sim,
            WorldKind::Real => Kind::Real,
        }
    }
}

impl From<Kind> for WorldKind {
    fn from(kind: Kind) -> WorldKind {
        match kind {
            Kind::Sim => WorldKind::Sim,
            Kind::Real => WorldKind::Real,
        }
    }
}

impl WorldOut {
    /// One of a list, at a moment.
    pub fn of(listed: &Listed, now: Duration) -> WorldOut {
        let idle_s = now.saturating_sub(listed.used).as_secs();
        WorldOut { idle_s, ..WorldOut::new(&listed.id, listed.owner.as_deref(), listed.world.describe()) }
    }

    /// One that is in use.
    pub fn new(id: &str, owner: Option<&str>, d: Description) -> WorldOut {
        let features = d.features.len();
        WorldOut {
            id: id.into(),
            owner: owner.map(String::from),
            idle_s: 0,
            task: d.task,
            kind: d.kind.into(),
            engine: d.engine.name(),
            sealed: d.sealed,
            latents: d.latents.map(LatentsOut::from),
            effects: d.effects.map(|terms| terms.into_iter().map(EffectIn::from).collect()),
            interactions: d.interactions,
            budget: d.budget,
            remaining: d.budget.map(|b| b.saturating_sub(d.interactions)),
            seed: d.seed,
            action_space: ActionSpaceOut::from(&d.actions),
            observation_space: ObservationSpaceOut {
                names: d.features,
                low: vec![0.0; features],
                high: vec![1.0; features],
            },
            state: StateOut { task: d.current, phase: d.phase.name(), episodes: d.episodes },
        }
    }
}

impl Bulk for WorldOut {}
impl Bulk for Worlds {}
