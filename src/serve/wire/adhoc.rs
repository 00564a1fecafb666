//! Ad-hoc simulations, and checks of placements.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use super::episode::end_name;
use super::rollout::BodyTrack;
use crate::commands::{LatentsIn, effects, engine};
use crate::error::{Error, Result, check_count};
use crate::json::JsonObject;
use crate::session::{Action, AdhocResult, AdhocSimulation, Catalogue};
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::trajectory::{Contact, Trajectory};
use crate::world::effect;

/// A rollout to simulate. Requires either `task` or `scene`.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulateIn {
    /// Id of a task (`bowling:017`).
    pub task: Option<String>,
    /// An `iplw.scene/1` document; `action` and `goal` are optional.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<JsonObject<Scene>>,
    /// Default: none; bodies start at their positions in the scene.
    pub action: Option<Action>,
    /// Latent factors; absent ones are the scene's own.
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<JsonObject<LatentsIn>>,
    /// Effects in addition to the scene's own.
    #[schema(value_type = Option<Vec<EffectTerm>>)]
    pub effects: Option<Vec<JsonObject<EffectTerm>>>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
    /// Time steps between two samples. Default: the scene's.
    pub observe_every: Option<u32>,
    /// Whether the rollout ends when the goal is reached. Default: true.
    pub stop: Option<bool>,
}

/// Result of an ad-hoc simulation.
#[derive(Serialize, ToSchema)]
pub struct SimulationOut {
    /// Engine that ran.
    pub engine: &'static str,
    /// Whether the action could be placed; if not, nothing was simulated.
    pub valid: bool,
    /// Why it could not be placed.
    pub reason: Option<String>,
    /// Whether the goal was reached; `null` if the scene has none.
    pub solved: Option<bool>,
    /// `horizon`, `goal` or `diverged`.
    pub end: Option<&'static str>,
    /// Simulated time steps.
    pub steps: u32,
    /// Times of the samples, s.
    pub t: Vec<f64>,
    /// By body name, one state per time.
    pub bodies: BTreeMap<String, BodyTrack>,
    /// Contacts, in order of time.
    pub contacts: Vec<ContactOut>,
}

/// Start of a contact between two objects.
#[derive(Serialize, Deserialize, ToSchema)]
pub struct ContactOut {
    /// s
    pub t: f64,
    /// Names of two bodies, or of a body and a static.
    pub between: [String; 2],
    /// Approach speed along the contact normal, m/s.
    pub speed: f64,
}

/// Actions to check for placement. Requires either `task` or `scene`.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlaceIn {
    /// Id of a task (`bowling:017`).
    pub task: Option<String>,
    /// An `iplw.scene/1` document with `action`.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<JsonObject<Scene>>,
    /// At most 4096.
    pub actions: Vec<Action>,
}

/// Result of the placement checks.
#[derive(Serialize, ToSchema)]
pub struct PlacementsOut {
    /// One per action: why it cannot be placed, `null` if it can.
    pub reasons: Vec<Option<String>>,
}

impl BinaryArrays for SimulationOut {}
impl BinaryArrays for PlacementsOut {}

impl SimulateIn {
    /// Converts the request.
    pub fn simulation(self, catalogue: &Catalogue) -> Result<AdhocSimulation> {
        // The upper end is that of the document's format `int32`.
        check_count("observe_every", self.observe_every, 1, i32::MAX as u32)?;
        Ok(AdhocSimulation {
            scene: scene(self.task, self.scene, catalogue)?,
            action: self.action,
            latents: self.latents.map(|o| o.0).unwrap_or_default().checked("latents.")?,
            effects: effects(None, self.effects, "")?.unwrap_or_default(),
            engine: engine(self.engine.as_deref())?,
            observe_every: self.observe_every,
            stop: self.stop.unwrap_or(true),
        })
    }
}

impl PlaceIn {
    /// The scene and the actions to check.
    pub fn read(self, catalogue: &Catalogue) -> Result<(Scene, Vec<Action>)> {
        Ok((scene(self.task, self.scene, catalogue)?, self.actions))
    }
}

/// The scene of the task or request, validated.
fn scene(task: Option<String>, scene: Option<JsonObject<Scene>>, catalogue: &Catalogue) -> Result<Scene> {
    match (task, scene) {
        (Some(task), None) => Ok(catalogue.task(&task)?.scene),
        (None, Some(JsonObject(scene))) => {
            scene
                .validate()
                .and_then(|()| effect::validate_terms(&scene.effects))
                .map_err(|e| e.in_field("scene"))?;
            Ok(scene)
        }
        (Some(_), Some(_)) => {
            Err(Error::input("scene", "given together with `task`", "one of task and scene"))
        }
        (None, None) => Err(Error::input("task", "missing", "one of task and scene")),
    }
}

impl From<AdhocResult> for SimulationOut {
    fn from(sketched: AdhocResult) -> SimulationOut {
        let engine = sketched.engine;
        match sketched.result {
            Ok(trajectory) => SimulationOut::of(engine, trajectory),
            Err(reason) => SimulationOut {
                engine,
                valid: false,
                reason: Some(reason),
                solved: None,
                end: None,
                steps: 0,
                t: Vec::new(),
                bodies: BTreeMap::new(),
                contacts: Vec::new(),
            },
        }
    }
}

impl SimulationOut {
    fn of(engine: &'static str, trajectory: Trajectory) -> SimulationOut {
        let tracks = trajectory.bodies.into_iter();
        let contact = |c: Contact| ContactOut { t: c.time, between: c.between, speed: c.speed };
        SimulationOut {
            engine,
            valid: true,
            reason: None,
            solved: trajectory.outcome.solved,
            end: Some(end_name(trajectory.outcome.end)),
            steps: trajectory.outcome.steps,
            t: trajectory.times,
            bodies: tracks.map(|b| (b.name, BodyTrack { x: b.x, y: b.y, angle: b.angle })).collect(),
            contacts: trajectory.events.into_iter().map(contact).collect(),
        }
    }
}
