//! A rollout of nobody's world, and where things can be placed in a scene.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::action::ActionIn;
use super::bulk::Bulk;
use super::episode::end_name;
use super::physics::{EffectIn, LatentsIn, effects};
use super::rollout::BodyTrack;
use super::strict::Object;
use super::world::engine;
use crate::error::{Error, Result};
use crate::session::{Action, Catalogue, Sketch, Sketched};
use crate::task::Scene;
use crate::trajectory::{Contact, Trajectory};
use crate::world::effect;

/// A rollout to simulate; one of `task` and `scene` is needed.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulateIn {
    /// Id of a task (`bowling:017`).
    pub task: Option<String>,
    /// An `iplw.scene/1` document; it needs neither `action` nor `goal`.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Object<Scene>>,
    /// What is placed before the start; without one, bodies start where the scene has them.
    pub action: Option<ActionIn>,
    /// Latent factors; those absent are the scene's own.
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<Object<LatentsIn>>,
    /// Effects beyond gravity and contact, and beyond the scene's own.
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<Object<EffectIn>>>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
    /// Time steps between two samples; the scene's own if absent.
    pub observe_every: Option<u32>,
    /// Whether it ends when the goal is reached; default true.
    pub stop: Option<bool>,
}

/// What became of it.
#[derive(Serialize, ToSchema)]
pub struct Simulated {
    /// Engine that ran.
    pub engine: &'static str,
    /// Whether the action could be placed; if not, nothing was simulated.
    pub valid: bool,
    /// Why it could not be placed.
    pub reason: Option<String>,
    /// Whether the goal was reached; `null` where the scene has none.
    pub solved: Option<bool>,
    /// `horizon`, `goal` or `diverged`.
    pub end: Option<&'static str>,
    /// Simulated time steps.
    pub steps: u32,
    /// Times of the samples, s.
    pub t: Vec<f64>,
    /// By body name, a state for each time.
    pub bodies: BTreeMap<String, BodyTrack>,
    /// Contacts that began, in order of time.
    pub contacts: Vec<ContactOut>,
}

/// Two things began to touch.
#[derive(Serialize, ToSchema)]
pub struct ContactOut {
    /// s
    pub t: f64,
    /// Names of two bodies, or of a body and a static.
    pub between: [String; 2],
    /// How fast they approached along the contact's normal, m/s.
    pub speed: f64,
}

/// Actions that may have a place; one of `task` and `scene` is needed.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlaceIn {
    /// Id of a task (`bowling:017`).
    pub task: Option<String>,
    /// An `iplw.scene/1` document with `action`.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Object<Scene>>,
    /// At most 4096.
    pub actions: Vec<ActionIn>,
}

/// Which actions have a place.
#[derive(Serialize, ToSchema)]
pub struct Places {
    /// One for each action: why it cannot be placed, `null` where it can.
    pub reasons: Vec<Option<String>>,
}

impl Bulk for Simulated {}
impl Bulk for Places {}

impl SimulateIn {
    /// What is to be simulated.
    pub fn sketch(self, catalogue: &Catalogue) -> Result<Sketch> {
        if self.observe_every == Some(0) {
            return Err(Error::input("observe_every", 0, "a whole number of time steps from 1"));
        }
        Ok(Sketch {
            scene: scene(self.task, self.scene, catalogue)?,
            action: self.action.map(Action::from),
            latents: self.latents.map(|o| o.0).unwrap_or_default().checked("latents.")?,
            effects: effects(None, self.effects, "")?.unwrap_or_default(),
            engine: engine(self.engine.as_deref())?,
            observe_every: self.observe_every,
            stop: self.stop.unwrap_or(true),
        })
    }
}

impl PlaceIn {
    /// The scene, and the actions to look at.
    pub fn read(self, catalogue: &Catalogue) -> Result<(Scene, Vec<Action>)> {
        let actions = self.actions.into_iter().map(Action::from).collect();
        Ok((scene(self.task, self.scene, catalogue)?, actions))
    }
}

/// The scene that is meant, checked.
fn scene(task: Option<String>, scene: Option<Object<Scene>>, catalogue: &Catalogue) -> Result<Scene> {
    match (task, scene) {
        (Some(task), None) => Ok(catalogue.task(&task)?.scene),
        (None, Some(Object(scene))) => {
            scene.validate().and_then(|()| effect::check(&scene.effects)).map_err(|e| e.under("scene"))?;
            Ok(scene)
        }
        (Some(_), Some(_)) => Err(Error::input("scene", "given beside `task`", "one of task and scene")),
        (None, None) => Err(Error::input("task", "missing", "one of task and scene")),
    }
}

impl From<Sketched> for Simulated {
    fn from(sketched: Sketched) -> Simulated {
        let engine = sketched.engine;
        match sketched.result {
            Ok(trajectory) => Simulated::of(engine, trajectory),
            Err(reason) => Simulated {
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

impl Simulated {
    fn of(engine: &'static str, trajectory: Trajectory) -> Simulated {
        let tracks = trajectory.bodies.into_iter();
        let contact = |c: Contact| ContactOut { t: c.time, between: c.between, speed: c.speed };
        Simulated {
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
