//! List of tasks.

use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::ToSchema;

use crate::serve::mcp::describe::describe_component;
use crate::serve::mcp::tool::{SideEffect, Tool, ToolCall, ToolResult, tool as declared};
use crate::serve::problem::HandlerResult;
use crate::serve::wire::TaskSummary;
use crate::task::Split;
use crate::task::action::ActionComponent;

pub fn tool() -> Tool {
    declared(
        "list_tasks",
        "List tasks",
        SideEffect::ReadOnly,
        "Lists the families of tasks, or the tasks of one family with their difficulty. Start here: the other tools take a \
         task's id such as bowling:017, some also a family such as bowling.",
        run,
    )
}

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct ListTasksArgs {
    /// Family whose tasks to list. Default: list the families.
    family: Option<String>,
    /// Maximum number of rows. Default: 25.
    #[schema(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// `next` of the previous result, to continue the list.
    cursor: Option<String>,
}

#[derive(Serialize, Deserialize, ToSchema)]
struct ListTasksOutput {
    /// Without `family`.
    #[serde(skip_serializing_if = "Option::is_none")]
    families: Option<Vec<FamilyListing>>,
    /// With `family`.
    #[serde(skip_serializing_if = "Option::is_none")]
    tasks: Option<Vec<TaskListing>>,
    /// Meaning of each action component, from 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    action: Option<Vec<String>>,
    /// `cursor` for more rows; null if there are none.
    next: Option<String>,
}

#[derive(Serialize, Deserialize, ToSchema)]
struct FamilyListing {
    name: String,
    /// Description.
    about: String,
    /// Number of tasks.
    tasks: usize,
}

/// A task without its certificate's action, which is a solution.
#[derive(Serialize, Deserialize, ToSchema)]
struct TaskListing {
    id: String,
    split: Split,
    /// Fraction of valid actions that solve it in the real world.
    solving_share: Option<f64>,
}

#[derive(Deserialize)]
struct FamilyResponse {
    tasks: Vec<TaskSummary>,
    action_space: ActionSpaceInfo,
    next: Option<String>,
}

#[derive(Deserialize)]
struct ActionSpaceInfo {
    components: Vec<ActionComponent>,
}

async fn run(call: ToolCall, args: ListTasksArgs) -> HandlerResult<ToolResult<ListTasksOutput>> {
    let page = json!({"limit": args.limit.unwrap_or(25), "cursor": args.cursor});
    let Some(family) = args.family else {
        let output: ListTasksOutput = call.read("list_families", page).await?;
        let families = output.families.iter().flatten();
        let lines: Vec<String> =
            families.map(|f| format!("{}: {} ({} tasks)", f.name, f.about, f.tasks)).collect();
        let summary = lines.join("\n");
        return Ok(ToolResult { summary, output, picture: None });
    };
    let page = json!({"family": family, "limit": page["limit"], "cursor": page["cursor"]});
    let found: FamilyResponse = call.read("list_tasks", page).await?;
    let tasks = found.tasks.into_iter().map(|row| TaskListing {
        id: row.id,
        split: row.split,
        solving_share: row.certificate.map(|c| c.solving_share),
    });
    let tasks: Vec<TaskListing> = tasks.collect();
    let range = match (tasks.first(), tasks.last()) {
        (Some(first), Some(last)) => format!("{} to {}", first.id, last.id),
        _ => "none".into(),
    };
    let components = found.action_space.components.iter().enumerate();
    let action: Vec<String> = components.map(|(i, c)| describe_component(i, c)).collect();
    let more = if found.next.is_some() { "; there are more (`next`)" } else { "" };
    let summary = format!("{} tasks, {range}{more}. {}.", tasks.len(), action.join("; "));
    let output =
        ListTasksOutput { families: None, tasks: Some(tasks), action: Some(action), next: found.next };
    Ok(ToolResult { summary, output, picture: None })
}
