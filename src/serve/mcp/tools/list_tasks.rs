//! Which tasks there are.

use rmcp::schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::serve::mcp::show::component_words;
use crate::serve::mcp::tool::{Call, Effect, Told, Tool, tool as declared};
use crate::serve::problem::Answer;
use crate::task::action::Component;

pub fn tool() -> Tool {
    declared(
        "list_tasks",
        "List tasks",
        Effect::Shows,
        "Lists the families of tasks, or the tasks of one family with how hard each is. Start here: the other tools take a \
         task's id such as bowling:017, and some of them a whole family such as bowling.",
        run,
    )
}

#[derive(Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct In {
    /// A family, to list its tasks; without one, the families are listed.
    family: Option<String>,
    /// Most rows; 25 if absent.
    #[schemars(range(min = 1, max = 1000))]
    limit: Option<u32>,
    /// `next` of the answer before, for the rows after those.
    cursor: Option<String>,
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Out {
    /// Where no family was named.
    #[serde(skip_serializing_if = "Option::is_none")]
    families: Option<Vec<FamilyRow>>,
    /// Of the family named.
    #[serde(skip_serializing_if = "Option::is_none")]
    tasks: Option<Vec<TaskRow>>,
    /// What each number of an action sets, each from 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    action: Option<Vec<String>>,
    /// Give it as `cursor` for more rows; null if there are none.
    next: Option<String>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct FamilyRow {
    name: String,
    /// What is asked for.
    about: String,
    /// How many there are.
    tasks: usize,
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct TaskRow {
    id: String,
    /// `train`, `validation` or `test`.
    split: String,
    /// Share of the actions that can be placed that solve it in the real world.
    solving_share: Option<f64>,
}

#[derive(Deserialize)]
struct Families {
    families: Vec<FamilyRow>,
    next: Option<String>,
}

#[derive(Deserialize)]
struct Family {
    tasks: Vec<Row>,
    action_space: Space,
    next: Option<String>,
}

#[derive(Deserialize)]
struct Row {
    id: String,
    split: String,
    certificate: Option<Certificate>,
}

/// Its action, which solves the task, is not for those who are to find one.
#[derive(Deserialize)]
struct Certificate {
    solving_share: f64,
}

#[derive(Deserialize)]
struct Space {
    components: Vec<Component>,
}

async fn run(call: Call, asked: In) -> Answer<Told<Out>> {
    let page = json!({"limit": asked.limit.unwrap_or(25), "cursor": asked.cursor});
    let Some(family) = asked.family else {
        let Families { families, next } = call.read("list_families", page).await?;
        let words = families.iter().map(|f| format!("{}: {} ({} tasks)", f.name, f.about, f.tasks));
        let words = words.collect::<Vec<_>>().join("\n");
        let told = Out { families: Some(families), tasks: None, action: None, next };
        return Ok(Told { words, told, picture: None });
    };
    let page = json!({"family": family, "limit": page["limit"], "cursor": page["cursor"]});
    let found: Family = call.read("list_tasks", page).await?;
    let tasks = found.tasks.into_iter().map(|row| TaskRow {
        id: row.id,
        split: row.split,
        solving_share: row.certificate.map(|c| c.solving_share),
    });
    let tasks: Vec<TaskRow> = tasks.collect();
    let range = match (tasks.first(), tasks.last()) {
        (Some(first), Some(last)) => format!("{} to {}", first.id, last.id),
        _ => "none".into(),
    };
    let components = found.action_space.components.iter().enumerate();
    let action: Vec<String> = components.map(|(i, c)| component_words(i, c)).collect();
    let more = if found.next.is_some() { "; there are more (`next`)" } else { "" };
    let words = format!("{} tasks, {range}{more}. {}.", tasks.len(), action.join("; "));
    let told = Out { families: None, tasks: Some(tasks), action: Some(action), next: found.next };
    Ok(Told { words, told, picture: None })
}
