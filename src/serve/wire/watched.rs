//! What is told of a world to those who watch it.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Serialize;
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use super::episode::{SplitIn, end_name};
use super::physics::LatentsOut;
use super::world::WorldOut;
use crate::session::{Brought, Film, Happened, Way, What};
use crate::task::Scene;

/// The first event of a watch, `world`: the world as it stands.
#[derive(Serialize, ToSchema)]
pub struct WatchOut {
    pub world: WorldOut,
    /// Its current task, or else its first.
    pub task: String,
    /// The scene of that task, as far as it is drawn: names, shapes, places, the goal and what an
    /// action sets.
    #[schema(value_type = Object)]
    pub scene: Value,
}

/// Something that happened in a world: an event named as `what` says.
#[derive(Default, Serialize, ToSchema)]
pub struct HappenedOut {
    /// The event's number, from 1.
    pub number: u64,
    /// `reset`, `step` (an action of an episode), `attempts` (actions beside it: a rollout, a film, a job), `latents` or `gone`.
    pub what: &'static str,
    /// Valid attempts in the world after it.
    pub interactions: u64,
    /// Of a reset, a step or attempts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub task: Option<String>,
    /// Of a reset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub split: Option<SplitIn>,
    /// Of a step, or of the attempt that `film` shows: a number from 0 to 1 for each component.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub action: Option<Vec<f64>>,
    /// Of a step: whether the action could be placed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub valid: Option<bool>,
    /// Why it could not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Of a step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solved: Option<bool>,
    /// Time steps of a step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<u32>,
    /// Of a step: `horizon`, `goal` or `diverged`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end: Option<&'static str>,
    /// Of attempts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attempts: Option<AttemptsOut>,
    /// Of a simulation whose latents were set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub latents: Option<LatentsOut>,
    /// What was observed: of a step, or of the last of the attempts where their trajectories were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub film: Option<FilmOut>,
}

/// How attempts beside the episode went.
#[derive(Serialize, ToSchema)]
pub struct AttemptsOut {
    pub tried: u64,
    /// Those that could be placed.
    pub valid: u64,
    pub solved: u64,
}

/// A trajectory as far as it is drawn: in single precision, a long one with fewer samples.
#[derive(Serialize, ToSchema)]
pub struct FilmOut {
    /// s
    pub t: Vec<f32>,
    /// By body name, a state for each time.
    pub bodies: BTreeMap<String, WayOut>,
}

/// Where a body was.
#[derive(Serialize, ToSchema)]
pub struct WayOut {
    /// m
    pub x: Vec<f32>,
    /// m, up
    pub y: Vec<f32>,
    /// rad, counter-clockwise
    pub angle: Vec<f32>,
}

/// What is drawn of a body or a static. Its material is not: of a real world's own scene that would be the truth.
const DRAWN: [&str; 4] = ["name", "shape", "position", "angle"];

/// A scene as far as it is drawn.
pub fn drawn(scene: &Scene) -> Value {
    let whole = serde_json::to_value(scene).unwrap_or_default();
    let things = |list: &str| -> Vec<Value> {
        let all = whole[list].as_array().into_iter().flatten();
        all.map(|thing| {
            let kept = DRAWN.iter().filter_map(|k| Some((k.to_string(), thing.get(k)?.clone())));
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

impl From<Arc<Happened>> for HappenedOut {
    fn from(event: Arc<Happened>) -> HappenedOut {
        let Happened { number, interactions, what } = &*event;
        let bare = HappenedOut { number: *number, interactions: *interactions, ..HappenedOut::default() };
        match what {
            What::Reset { task, split } => {
                HappenedOut { what: "reset", task: Some(task.clone()), split: Some((*split).into()), ..bare }
            }
            What::Step { task, action, brought } => {
                let bare = HappenedOut {
                    what: "step",
                    task: Some(task.clone()),
                    action: Some(action.clone()),
                    ..bare
                };
                match brought {
                    Brought::Refused(reason) => {
                        HappenedOut { valid: Some(false), reason: Some(reason.clone()), ..bare }
                    }
                    Brought::Done { solved, steps, end, film } => HappenedOut {
                        valid: Some(true),
                        solved: Some(*solved),
                        steps: Some(*steps),
                        end: Some(end_name(*end)),
                        film: film.as_ref().map(FilmOut::from),
                        ..bare
                    },
                }
            }
            What::Attempts { task, tried, valid, solved, film } => HappenedOut {
                what: "attempts",
                task: Some(task.clone()),
                attempts: Some(AttemptsOut { tried: *tried, valid: *valid, solved: *solved }),
                action: film.as_ref().map(|(action, _)| action.clone()),
                film: film.as_ref().map(|(_, film)| film.into()),
                ..bare
            },
            What::Latents(latents) => {
                HappenedOut { what: "latents", latents: Some((*latents).into()), ..bare }
            }
            What::Gone => HappenedOut { what: "gone", ..bare },
        }
    }
}

impl From<&Film> for FilmOut {
    fn from(film: &Film) -> FilmOut {
        let way = |b: &Way| WayOut { x: b.x.clone(), y: b.y.clone(), angle: b.angle.clone() };
        FilmOut { t: film.t.clone(), bodies: film.bodies.iter().map(|b| (b.name.clone(), way(b))).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_and_effects_are_not_drawn() {
        let scene: Scene = crate::json::parse(
            r#"{"format": "iplw.scene/1", "gravity": [0, -3], "damping": 0.5,
                "effects": [{"name": "wind", "parameters": {"ax": 1, "ay": 0}}],
                "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 1],
                    "density": 7.5, "friction": 0.25, "restitution": 0.75, "velocity": [1, 2]}],
                "statics": [{"name": "floor", "shape": {"type": "segment", "from": [-1, 0], "to": [1, 0]},
                    "friction": 0.25, "restitution": 0.75}]}"#,
        )
        .unwrap();
        let text = drawn(&scene).to_string();
        assert!(text.contains("\"radius\":0.1") && text.contains("\"floor\""), "{text}");
        for hidden in ["density", "friction", "restitution", "gravity", "damping", "wind", "velocity", "7.5"]
        {
            assert!(!text.contains(hidden), "{hidden}: {text}");
        }
    }
}
