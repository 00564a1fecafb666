//! Description and picture of a task.

use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::ToSchema;

use crate::error::Result;
use crate::serve::mcp::agent_session::{InteractionBudget, family};
use crate::serve::mcp::describe::{PICTURE_WIDTH_PX, describe_component, describe_goal, describe_scene};
use crate::serve::mcp::tool::{SideEffect, Tool, ToolCall, ToolResult, tool as declared};
use crate::serve::problem::HandlerResult;
use crate::serve::wire::TaskOut;
use crate::task::{Placement, Scene};

pub fn tool() -> Tool {
    declared(
        "look",
        "Look at a task",
        SideEffect::ReadOnly,
        "Shows a task as a picture and as text: objects with positions (m, y up), the goal, and the meaning of each action \
         component. With an action, shows it placed, or why it cannot be placed. Costs no interaction.",
        run,
    )
}

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct LookArgs {
    /// Id of the task, such as bowling:017.
    task: String,
    /// Action to place: numbers from 0 to 1, one per component.
    action: Option<Vec<f64>>,
}

#[derive(Serialize, ToSchema)]
struct LookOutput {
    task: String,
    /// The goal.
    goal: Option<String>,
    /// Objects with their positions.
    things: Vec<String>,
    /// Meaning of each action component.
    action: Vec<String>,
    /// Why the action cannot be placed; null if it can, or if none was given.
    obstacle: Option<String>,
    /// The scene as an `iplw.scene/1` document, for `roll_out` and `diagnose`; you can modify it.
    #[schema(value_type = Object)]
    scene: Scene,
    /// Budget of the family's real world.
    budget: InteractionBudget,
}

async fn run(call: ToolCall, args: LookArgs) -> HandlerResult<ToolResult<LookOutput>> {
    let TaskOut { id, scene, .. } = call.task(&args.task).await?;
    let obstacle = match &args.action {
        None => None,
        Some(action) => obstacle(&scene, action)?,
    };
    let placed = args.action.filter(|_| obstacle.is_none());
    let world = format!("{}-sim", family(&id));
    let action = placed.map(|a| a.iter().map(f64::to_string).collect::<Vec<_>>().join(","));
    let request = json!({"id": world, "task": id, "action": action, "width": PICTURE_WIDTH_PX});
    let picture = call.ask("render_world", request).await?;
    let components = scene.action.iter().flat_map(|space| &space.components).enumerate();
    let output = LookOutput {
        goal: scene.goal.as_ref().map(describe_goal),
        things: describe_scene(&scene),
        action: components.map(|(i, c)| describe_component(i, c)).collect(),
        obstacle,
        budget: call.session().spent(family(&id)).await?,
        scene,
        task: id,
    };
    Ok(ToolResult { summary: summary(&output), output, picture: Some(picture) })
}

fn summary(output: &LookOutput) -> String {
    let goal = output.goal.as_deref().unwrap_or("none");
    let mut lines = vec![format!("{}. Goal: {goal}.", output.task)];
    lines.extend(output.things.iter().chain(&output.action).cloned());
    lines.extend(output.obstacle.iter().map(|why| format!("The action cannot be placed: {why}.")));
    lines.push(output.budget.summary());
    lines.join("\n")
}

/// Why an action cannot be placed; `None` if it can.
fn obstacle(scene: &Scene, action: &[f64]) -> Result<Option<String>> {
    let Some(space) = &scene.action else { return Ok(None) };
    Ok(match space.place(scene, &space.validate(action)?) {
        Placement::Valid(_) => None,
        Placement::Invalid(reason) => Some(reason),
    })
}
