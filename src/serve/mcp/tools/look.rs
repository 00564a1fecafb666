//! What a task looks like.

use rmcp::schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::error::Result;
use crate::json::from_value;
use crate::serve::mcp::desk::{Budget, family};
use crate::serve::mcp::show::{WIDTH, component_words, goal_words, scene_words};
use crate::serve::mcp::tool::{Call, Effect, Told, Tool, tool as declared};
use crate::serve::problem::Answer;
use crate::task::{Placement, Scene};

pub fn tool() -> Tool {
    declared(
        "look",
        "Look at a task",
        Effect::Shows,
        "Shows a task as a picture and in words: what stands where (m, y up), what is asked for, and what each number of an \
         action sets. With an action, the picture has it placed, and it is said whether it can be placed at all. Costs no \
         interaction.",
        run,
    )
}

#[derive(Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct In {
    /// Id of the task, such as bowling:017.
    task: String,
    /// Numbers from 0 to 1, one for each component, to see them placed.
    action: Option<Vec<f64>>,
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Out {
    task: String,
    /// What is asked for.
    goal: Option<String>,
    /// What stands where, as the task has it.
    things: Vec<String>,
    /// What each number of an action sets.
    action: Vec<String>,
    /// Why the action given cannot be placed; null if it can, or none was given.
    obstacle: Option<String>,
    /// The same task as an `iplw.scene/1` document, which `roll_out` and `diagnose` take, changed or not.
    scene: Value,
    /// Of the real world of the task's family.
    budget: Budget,
}

#[derive(Deserialize)]
struct Task {
    id: String,
    scene: Value,
}

async fn run(call: Call, asked: In) -> Answer<Told<Out>> {
    let task = found(&call, &asked.task).await?;
    let scene: Scene = from_value(task.scene.clone())?;
    let obstacle = match &asked.action {
        None => None,
        Some(action) => obstacle(&scene, action)?,
    };
    let placed = asked.action.filter(|_| obstacle.is_none());
    let world = format!("{}-sim", family(&task.id));
    let action = placed.map(|a| a.iter().map(f64::to_string).collect::<Vec<_>>().join(","));
    let wish = json!({"id": world, "task": task.id, "action": action, "width": WIDTH});
    let picture = call.picture("render_world", wish).await?;
    let components = scene.action.iter().flat_map(|space| &space.components).enumerate();
    let told = Out {
        goal: scene.goal.as_ref().map(goal_words),
        things: scene_words(&scene),
        action: components.map(|(i, c)| component_words(i, c)).collect(),
        obstacle,
        scene: task.scene,
        budget: call.desk().spent(family(&task.id)).await?,
        task: task.id,
    };
    Ok(Told { words: words(&told), told, picture: Some(picture) })
}

fn words(told: &Out) -> String {
    let goal = told.goal.as_deref().unwrap_or("nothing is asked for");
    let mut lines = vec![format!("{}. Goal: {goal}.", told.task)];
    lines.extend(told.things.iter().chain(&told.action).cloned());
    lines.extend(told.obstacle.iter().map(|why| format!("The action cannot be placed: {why}.")));
    lines.push(told.budget.words());
    lines.join("\n")
}

/// Why an action cannot be placed.
fn obstacle(scene: &Scene, action: &[f64]) -> Result<Option<String>> {
    let Some(space) = &scene.action else { return Ok(None) };
    Ok(match space.place(scene, &space.validate(action)?) {
        Placement::Valid(_) => None,
        Placement::Invalid(reason) => Some(reason),
    })
}

/// A task by its id.
async fn found(call: &Call, id: &str) -> Answer<Task> {
    let (family, number) = id.split_once(':').unwrap_or((id, ""));
    call.read("get_task", json!({"family": family, "number": number})).await
}
