//! Events of a world's event stream.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Serialize;
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use super::episode::end_name;
use super::physics::LatentsOut;
use super::world::WorldOut;
use crate::session::{BodyPath, Recording, StepOutcome, WorldEvent, WorldEventKind};
use crate::task::{Scene, Split};

/// The first event, `world`: the current state of the world.
#[derive(Serialize, ToSchema)]
pub struct WatchStart {
    pub world: WorldOut,
    /// The current task, or the first if there is none.
    pub task: String,
    /// The scene of that task without hidden properties: names, shapes, poses, goal and action space.
    #[schema(value_type = Object)]
    pub scene: Value,
}

/// An event in a world, of the type `what`.
#[derive(Default, Serialize, ToSchema)]
pub struct WorldEventOut {
    /// Number of the event, from 1.
    pub number: u64,
    /// `reset`, `step` (an action of an episode), `attempts` (outside it: rollouts, renders, jobs), `latents` or `gone` (deleted).
    pub what: &'static str,
    /// Valid attempts in the world after the event.
    pub interactions: u64,
    /// With `reset`, `step` and `attempts`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub task: Option<String>,
    /// With `reset`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub split: Option<Split>,
    /// With `step`, or of the attempt in `film`: components from 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub action: Option<Vec<f64>>,
    /// With `step`: whether the action could be placed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub valid: Option<bool>,
    /// Why it could not be placed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// With `step`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solved: Option<bool>,
    /// With `step`: simulated time steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<u32>,
    /// With `step`: `horizon`, `goal` or `diverged`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end: Option<&'static str>,
    /// With `attempts`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attempts: Option<AttemptsOut>,
    /// With `latents`: the new values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub latents: Option<LatentsOut>,
    /// The observed trajectory: of the step, or of the last attempt if trajectories were requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub film: Option<RecordingOut>,
}

/// Counts of attempts outside the episode.
#[derive(Serialize, ToSchema)]
pub struct AttemptsOut {
    pub tried: u64,
    /// Those that could be placed.
    pub valid: u64,
    pub solved: u64,
}

/// A trajectory for drawing: single precision, and fewer samples if it is long.
#[derive(Serialize, ToSchema)]
pub struct RecordingOut {
    /// s
    pub t: Vec<f32>,
    /// By body name, one pose per time.
    pub bodies: BTreeMap<String, BodyPathOut>,
}

/// Poses of a body.
#[derive(Serialize, ToSchema)]
pub struct BodyPathOut {
    /// m
    pub x: Vec<f32>,
    /// m, up
    pub y: Vec<f32>,
    /// rad, counter-clockwise
    pub angle: Vec<f32>,
}

/// Published fields of bodies and statics. Materials are not among them: they would reveal a real world's latents.
const DRAWABLE_FIELDS: [&str; 4] = ["name", "shape", "position", "angle"];

/// The parts of a scene needed for drawing.
pub fn drawable_scene(scene: &Scene) -> Value {
    let whole = serde_json::to_value(scene).unwrap_or_default();
    let things = |list: &str| -> Vec<Value> {
        let all = whole[list].as_array().into_iter().flatten();
        all.map(|thing| {
            let kept = DRAWABLE_FIELDS.iter().filter_map(|k| Some((k.to_string(), thing.get(k)?.clone())));
            Value::Object(kept.collect::<Map<_, _>>())
        })
        .collect()
    };
    json!({
        "format": whole["format"],
        "name": scene.name,
        "bodies": things("bodies"),
        "statics": things("statics"),
        "goal": whole["goal"],
        "action": whole["action"],
        "time_step": scene.time_step,
        "steps": scene.steps,
    })
}

impl From<Arc<WorldEvent>> for WorldEventOut {
    fn from(event: Arc<WorldEvent>) -> WorldEventOut {
        let WorldEvent { number, interactions, what } = &*event;
        let bare = WorldEventOut { number: *number, interactions: *interactions, ..WorldEventOut::default() };
        match what {
            WorldEventKind::Reset { task, split } => {
                WorldEventOut { what: "reset", task: Some(task.clone()), split: Some(*split), ..bare }
            }
            WorldEventKind::Step { task, action, outcome } => {
                let bare = WorldEventOut {
                    what: "step",
                    task: Some(task.clone()),
                    action: Some(action.clone()),
                    ..bare
                };
                match outcome {
                    StepOutcome::Refused(reason) => {
                        WorldEventOut { valid: Some(false), reason: Some(reason.clone()), ..bare }
                    }
                    StepOutcome::Done { solved, steps, end, film } => WorldEventOut {
                        valid: Some(true),
                        solved: Some(*solved),
                        steps: Some(*steps),
                        end: Some(end_name(*end)),
                        film: film.as_ref().map(RecordingOut::from),
                        ..bare
                    },
                }
            }
            WorldEventKind::Attempts { task, tried, valid, solved, film } => WorldEventOut {
                what: "attempts",
                task: Some(task.clone()),
                attempts: Some(AttemptsOut { tried: *tried, valid: *valid, solved: *solved }),
                action: film.as_ref().map(|(action, _)| action.clone()),
                film: film.as_ref().map(|(_, film)| film.into()),
                ..bare
            },
            WorldEventKind::Latents(latents) => {
                WorldEventOut { what: "latents", latents: Some((*latents).into()), ..bare }
            }
            WorldEventKind::Deleted => WorldEventOut { what: "gone", ..bare },
        }
    }
}

impl From<&Recording> for RecordingOut {
    fn from(film: &Recording) -> RecordingOut {
        let way = |b: &BodyPath| BodyPathOut { x: b.x.clone(), y: b.y.clone(), angle: b.angle.clone() };
        RecordingOut {
            t: film.t.clone(),
            bodies: film.bodies.iter().map(|b| (b.name.clone(), way(b))).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hides_materials_and_effects() {
        let scene: Scene = crate::json::parse(
            r#"{"format": "iplw.scene/1", "gravity": [0, -3], "damping": 0.5,
                "effects": [{"name": "wind", "parameters": {"ax": 1, "ay": 0}}],
                "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 1],
                    "density": 7.5, "friction": 0.25, "restitution": 0.75, "velocity": [1, 2]}],
                "statics": [{"name": "floor", "shape": {"type": "segment", "from": [-1, 0], "to": [1, 0]},
                    "friction": 0.25, "restitution": 0.75}]}"#,
        )
        .unwrap();
        let text = drawable_scene(&scene).to_string();
        assert!(text.contains("\"radius\":0.1") && text.contains("\"floor\""), "{text}");
        for hidden in ["density", "friction", "restitution", "gravity", "damping", "wind", "velocity", "7.5"]
        {
            assert!(!text.contains(hidden), "{hidden}: {text}");
        }
    }
}
