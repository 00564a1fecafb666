//! Simulated rollouts: many actions, with latents of the agent's choice.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use crate::commands::LatentsIn;
use crate::error::Error;
use crate::serve::mcp::describe::RolloutTrajectory;
use crate::serve::mcp::tool::{SideEffect, Tool, ToolCall, ToolResult, tool as declared};
use crate::serve::problem::HandlerResult;
use crate::serve::wire::ContactOut;
use crate::task::scene::EffectTerm;

pub fn tool() -> Tool {
    declared(
        "roll_out",
        "Roll out in simulation",
        SideEffect::ReadOnly,
        "Simulates actions in a task or in your own scene with the latents and effects you choose, and returns whether each solves \
         the task, with a path and filmstrip of one of them. Not counted: try as many as you like. The simulation is only as \
         accurate as the latents; absent ones are the scene's own, which differ from the real world's.",
        run,
    )
}

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct RollOutArgs {
    /// Id of a task, such as bowling:017; either this or `scene`.
    task: Option<String>,
    /// An iplw.scene/1 document, as returned by `look` and `diagnose`.
    #[schema(value_type = Option<Object>)]
    scene: Option<Map<String, Value>>,
    /// 1 to 32 actions, each with numbers from 0 to 1, one per component; optional for a scene with all bodies placed.
    #[schema(min_items = 1, max_items = 32)]
    actions: Option<Vec<Vec<f64>>>,
    /// Latent factors to simulate with; absent ones are the scene's own.
    #[schema(value_type = Option<LatentsIn>)]
    latents: Option<Value>,
    /// Effects in addition to the scene's own.
    #[schema(value_type = Option<Vec<EffectTerm>>)]
    effects: Option<Value>,
    /// Index of the action to show, from 0. Default: the first that solves the task, or the first that can be placed.
    film: Option<usize>,
}

#[derive(Serialize, ToSchema)]
struct RollOutOutput {
    /// Number of actions that solve the task.
    solved: usize,
    /// In the order of the actions.
    results: Vec<RolloutRow>,
    /// Index of the shown action, from 0; null if none could be placed.
    filmed: Option<usize>,
    /// Paths of the shown action by body: rows [t in s, x in m, y in m].
    paths: BTreeMap<String, Vec<[f64; 3]>>,
}

#[derive(Serialize, ToSchema)]
struct RolloutRow {
    /// Null without an action.
    action: Option<Vec<f64>>,
    /// Why it cannot be placed; null if it can.
    reason: Option<String>,
    /// Whether the goal was reached; null if there is none.
    solved: Option<bool>,
    /// Simulated duration, s.
    seconds: f64,
    /// The first contacts between objects.
    contacts: Vec<ContactOut>,
}

#[derive(Deserialize)]
struct SimulatedRollout {
    #[serde(flatten)]
    rolled: RolloutTrajectory,
    contacts: Vec<ContactOut>,
}

/// Maximum number of actions per call, to keep results readable.
const MAX_ACTIONS: usize = 32;
/// Maximum number of contacts per rollout.
const MAX_CONTACTS: usize = 8;

async fn run(call: ToolCall, args: RollOutArgs) -> HandlerResult<ToolResult<RollOutOutput>> {
    let actions = actions(args.actions)?;
    let (mut results, mut films) = (Vec::new(), Vec::new());
    for (i, action) in actions.iter().enumerate() {
        let request = json!({
            "task": args.task, "scene": args.scene, "action": action, "latents": args.latents, "effects": args.effects,
        });
        let simulated: SimulatedRollout = call.read("simulate", request).await.map_err(|mut problem| {
            if problem.field.as_deref().is_some_and(|field| field.starts_with("action")) {
                problem.detail = format!("actions[{i}]: {}", problem.detail);
            }
            problem
        })?;
        let SimulatedRollout { rolled, mut contacts } = simulated;
        contacts.truncate(MAX_CONTACTS);
        results.push(RolloutRow {
            action: action.clone(),
            reason: rolled.reason.clone(),
            solved: rolled.solved,
            seconds: rolled.t.last().copied().unwrap_or(0.0),
            contacts,
        });
        films.push(rolled);
    }
    let solved = results.iter().filter(|r| r.solved == Some(true)).count();
    let filmed = filmed(args.film, &results)?;
    let summary = summary(&films, solved);
    let (mut paths, mut picture) = (BTreeMap::new(), None);
    if let Some(at) = filmed {
        let scene = match (args.task, args.scene) {
            (Some(task), _) => call.task(&task).await?.scene,
            (None, scene) => crate::json::from_value(Value::Object(scene.unwrap_or_default()))?,
        };
        let film = films.swap_remove(at);
        paths = film.paths();
        picture = Some(film.filmstrip(scene, actions[at].clone()).await?);
    }
    Ok(ToolResult { summary, output: RollOutOutput { solved, results, filmed, paths }, picture })
}

/// The actions to simulate; `None` for the scene without an action.
fn actions(args: Option<Vec<Vec<f64>>>) -> HandlerResult<Vec<Option<Vec<f64>>>> {
    let Some(actions) = args else { return Ok(vec![None]) };
    if !(1..=MAX_ACTIONS).contains(&actions.len()) {
        let allowed = format!("1 to {MAX_ACTIONS} actions per call");
        return Err(Error::input("actions", format!("{} actions", actions.len()), allowed).into());
    }
    Ok(actions.into_iter().map(Some).collect())
}

/// The requested action, or the first that solves the task, or the first that can be placed.
fn filmed(args: Option<usize>, results: &[RolloutRow]) -> HandlerResult<Option<usize>> {
    match args {
        Some(at) if at < results.len() => Ok(Some(at).filter(|at| results[*at].reason.is_none())),
        Some(at) => {
            let allowed = format!("the index of an action, 0 to {}", results.len() - 1);
            Err(Error::input("film", at, allowed).into())
        }
        None => {
            let solves = results.iter().position(|r| r.solved == Some(true));
            Ok(solves.or_else(|| results.iter().position(|r| r.reason.is_none())))
        }
    }
}

fn summary(films: &[RolloutTrajectory], solved: usize) -> String {
    let each: Vec<String> = films.iter().enumerate().map(|(i, f)| format!("{i}: {}", f.summary())).collect();
    format!("Simulated, {solved} of {} solve the task.\n{}", films.len(), each.join("\n"))
}
