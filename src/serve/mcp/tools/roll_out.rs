//! Simulated rollouts: many actions, with latents of the agent's choice.

use std::collections::BTreeMap;

use rmcp::schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use crate::error::Error;
use crate::serve::mcp::desk::family;
use crate::serve::mcp::show::{Path, Rolled};
use crate::serve::mcp::tool::{Call, Effect, EffectTerm, Latents, Told, Tool, tool as declared};
use crate::serve::problem::Answer;
use crate::task::Scene;

pub fn tool() -> Tool {
    declared(
        "roll_out",
        "Roll out in simulation",
        Effect::Shows,
        "Simulates actions in a task, or a scene of yours, with the latents and effects that you give, and tells of each \
         whether it solves the task; one of them is filmed and told as a path. Nothing is counted: try as many as you like. \
         What is simulated is as right as the latents are: those absent are the scene's own, which are not the real world's.",
        run,
    )
}

#[derive(Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct In {
    /// Id of a task, such as bowling:017; this or `scene`.
    task: Option<String>,
    /// An iplw.scene/1 document, as `look` and `diagnose` give it.
    scene: Option<Map<String, Value>>,
    /// 1 to 32 actions, each with a number from 0 to 1 for every component; may be absent for a scene in which everything
    /// is placed.
    #[schemars(length(min = 1, max = 32))]
    actions: Option<Vec<Vec<f64>>>,
    /// Latent factors to simulate with; those absent are the scene's own.
    latents: Option<Latents>,
    /// Effects beyond gravity and contact, and beyond the scene's own.
    effects: Option<Vec<EffectTerm>>,
    /// Which action is filmed, counted from 0; the first that solves the task if absent, or else the first that can be
    /// placed.
    film: Option<usize>,
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Out {
    /// How many of the actions solve the task.
    solved: usize,
    /// In the order of the actions.
    results: Vec<Row>,
    /// Which of them is filmed, from 0; null if none could be placed.
    filmed: Option<usize>,
    /// Of that one: by body rows of [t in s, x in m, y in m].
    paths: BTreeMap<String, Path>,
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Row {
    /// Null where nothing was to be placed.
    action: Option<Vec<f64>>,
    /// Why it cannot be placed; null if it can.
    reason: Option<String>,
    /// Whether the goal was reached; null where there is none.
    solved: Option<bool>,
    /// How long it was simulated, s.
    seconds: f64,
    /// The first contacts between things.
    contacts: Vec<Contact>,
}

/// Two things began to touch.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Contact {
    /// s
    t: f64,
    /// Names of two bodies, or of a body and something fixed.
    between: [String; 2],
    /// How fast they approached, m/s.
    speed: f64,
}

#[derive(Deserialize)]
struct Simulated {
    #[serde(flatten)]
    rolled: Rolled,
    contacts: Vec<Contact>,
}

/// Most actions of a call: an agent reads what comes back.
const MOST: usize = 32;
/// Contacts that are told.
const CONTACTS: usize = 8;

async fn run(call: Call, asked: In) -> Answer<Told<Out>> {
    let actions = actions(asked.actions)?;
    let (mut results, mut films) = (Vec::new(), Vec::new());
    for (i, action) in actions.iter().enumerate() {
        let wish = json!({
            "task": asked.task, "scene": asked.scene, "action": action, "latents": asked.latents, "effects": asked.effects,
        });
        let simulated: Simulated = call.read("simulate", wish).await.map_err(|mut problem| {
            if problem.field.as_deref().is_some_and(|field| field.starts_with("action")) {
                problem.detail = format!("actions[{i}]: {}", problem.detail);
            }
            problem
        })?;
        let Simulated { rolled, mut contacts } = simulated;
        contacts.truncate(CONTACTS);
        results.push(Row {
            action: action.clone(),
            reason: rolled.reason.clone(),
            solved: rolled.solved,
            seconds: rolled.t.last().copied().unwrap_or(0.0),
            contacts,
        });
        films.push(rolled);
    }
    let solved = results.iter().filter(|r| r.solved == Some(true)).count();
    let filmed = filmed(asked.film, &results)?;
    let words = words(&films, solved);
    let (mut paths, mut picture) = (BTreeMap::new(), None);
    if let Some(at) = filmed {
        let scene: Scene = match (asked.task, asked.scene) {
            (Some(task), _) => scene_of(&call, &task).await?,
            (None, scene) => crate::json::from_value(Value::Object(scene.unwrap_or_default()))?,
        };
        let film = films.swap_remove(at);
        paths = film.paths();
        picture = Some(film.film(scene, actions[at].clone()).await?);
    }
    Ok(Told { words, told: Out { solved, results, filmed, paths }, picture })
}

/// What is to be simulated; `None`: the scene as it stands.
fn actions(asked: Option<Vec<Vec<f64>>>) -> Answer<Vec<Option<Vec<f64>>>> {
    let Some(actions) = asked else { return Ok(vec![None]) };
    if !(1..=MOST).contains(&actions.len()) {
        let allowed = format!("1 to {MOST} of them in a call");
        return Err(Error::input("actions", format!("{} actions", actions.len()), allowed).into());
    }
    Ok(actions.into_iter().map(Some).collect())
}

/// The one asked for, or the first that solves the task, or the first that can be placed.
fn filmed(asked: Option<usize>, results: &[Row]) -> Answer<Option<usize>> {
    match asked {
        Some(at) if at < results.len() => Ok(Some(at).filter(|at| results[*at].reason.is_none())),
        Some(at) => {
            let allowed = format!("the number of an action, 0 to {}", results.len() - 1);
            Err(Error::input("film", at, allowed).into())
        }
        None => {
            let solves = results.iter().position(|r| r.solved == Some(true));
            Ok(solves.or_else(|| results.iter().position(|r| r.reason.is_none())))
        }
    }
}

fn words(films: &[Rolled], solved: usize) -> String {
    let each: Vec<String> = films.iter().enumerate().map(|(i, f)| format!("{i}: {}", f.words())).collect();
    format!("Simulated, {solved} of {} solve the task.\n{}", films.len(), each.join("\n"))
}

/// A task's scene.
pub async fn scene_of(call: &Call, task: &str) -> Answer<Scene> {
    #[derive(Deserialize)]
    struct Task {
        scene: Scene,
    }
    let number = task.split_once(':').map_or("", |(_, number)| number);
    let found: Task = call.read("get_task", json!({"family": family(task), "number": number})).await?;
    Ok(found.scene)
}
