//! MCP resources (documentation) and prompts.

use rmcp::ErrorData;
use rmcp::model::{
    GetPromptResult, JsonObject, Prompt, PromptArgument, PromptMessage, ReadResourceResult, Resource,
    ResourceContents, Role,
};
use serde_json::{Value, json};

use super::tool::ToolCall;

/// Instructions sent when an agent connects.
pub const INSTRUCTIONS: &str = "\
2D physics worlds with hidden latent factors (density, friction, restitution) and effects. A task is solved by one action, a \
vector of numbers from 0 to 1 that places objects. roll_out simulates with latents of your choice, without limit; measure acts \
in the real world, whose latents are hidden, and each such interaction counts against a budget. To calibrate: \
propose_actions, measure each proposal, propose_actions again (which returns the estimates so far), then roll_out with these \
latents; or let estimate do all of it. If latents stay unidentified or the simulation stays wrong, an effect is missing: \
diagnose finds it, from trials or from measured proposals; then list its parameters in `fit`. SI units, y up.";

/// A page of documentation, compiled into the program.
struct DocPage {
    uri: &'static str,
    name: &'static str,
    about: &'static str,
    text: &'static str,
}

const PAGES: [DocPage; 2] = [
    DocPage {
        uri: "iplw://docs/agents",
        name: "agents.md",
        about: "Guide for agents: tools, budget, tokens, an example session.",
        text: include_str!("../../../docs/how-to/agents.md"),
    },
    DocPage {
        uri: "iplw://docs/formats",
        name: "formats.md",
        about: "Scenes (iplw.scene/1), trials as CSV, tracks of other programs, diagnoses.",
        text: include_str!("../../../docs/reference/formats.md"),
    },
];

/// URI of the list of effects.
const EFFECTS: &str = "iplw://effects";

/// All resources.
pub fn resources() -> Vec<Resource> {
    let page = |p: &DocPage| {
        Resource::new(p.uri, p.name)
            .with_description(p.about)
            .with_mime_type("text/markdown")
            .with_size(p.text.len() as u64)
    };
    let effects = Resource::new(EFFECTS, "effects.json")
        .with_description("Effects beyond gravity and contact: equation, parameters, units and bounds.")
        .with_mime_type("application/json");
    PAGES.iter().map(page).chain([effects]).collect()
}

/// Reads a resource.
pub async fn resource(call: &ToolCall, uri: &str) -> Result<ReadResourceResult, ErrorData> {
    let (text, kind) = match PAGES.iter().find(|p| p.uri == uri) {
        Some(page) => (page.text.to_string(), "text/markdown"),
        None if uri == EFFECTS => {
            let effects = call.read::<Value>("list_effects", json!({"limit": 1000})).await;
            let effects = effects.map_err(|problem| ErrorData::internal_error(problem.detail, None))?;
            (effects["effects"].to_string(), "application/json")
        }
        None => {
            let uris: Vec<&str> = PAGES.iter().map(|p| p.uri).chain([EFFECTS]).collect();
            let said = format!("unknown resource {uri}; available: {}", uris.join(", "));
            return Err(ErrorData::resource_not_found(said, None));
        }
    };
    Ok(ReadResourceResult::new(vec![ResourceContents::text(text, uri).with_mime_type(kind)]))
}

const CALIBRATE: &str = "calibrate";
const WRONG: &str = "what_is_wrong";

/// All prompts.
pub fn prompts() -> Vec<Prompt> {
    let argument =
        |name: &str, about: &str| PromptArgument::new(name).with_description(about).with_required(true);
    let of_task = argument("task", "Id of the task, such as bowling:017");
    let of_trials = argument("trials", "Measured trials as CSV, or where to find them");
    vec![
        Prompt::new(
            CALIBRATE,
            Some("Calibrate a simulation, and solve a task in the real world"),
            Some(vec![of_task]),
        ),
        Prompt::new(
            WRONG,
            Some("Find the effects that a simulation of measured trials lacks"),
            Some(vec![of_trials]),
        ),
    ]
}

/// A prompt with its argument filled in.
pub fn prompt(name: &str, arguments: Option<&JsonObject>) -> Result<GetPromptResult, ErrorData> {
    let given = |field: &str| {
        let value = arguments.and_then(|a| a.get(field)).and_then(Value::as_str);
        value.ok_or_else(|| ErrorData::invalid_params(format!("`{field}` is missing; allowed: text"), None))
    };
    let text = match name {
        CALIBRATE => format!(
            "Solve the task {} in the real world with as few real interactions as possible. Look at it. Call propose_actions, \
             measure the proposals, and repeat until friction and restitution are known well enough. If they stay \
             unidentified, use diagnose to find the effect that the simulation lacks, and start again with it in `fit`. Then use \
             roll_out with these latents and effects to find an action that solves the task, also when slightly perturbed, and \
             measure it. Report the action, the latents with their intervals, and the interactions used.",
            given("task")?
        ),
        WRONG => format!(
            "Find the effects that a simulation of these trials lacks: {}\nRead iplw://docs/formats for the columns. Diagnose \
             them with their scene, or with one ball of the right radius. Report the verdict with its reason, the effects with \
             their intervals, the rivals that the data cannot distinguish, and the recommended next experiment. If there are \
             too few data, state what is needed.",
            given("trials")?
        ),
        _ => {
            let said = format!("unknown prompt {name:?}; available: {CALIBRATE} and {WRONG}");
            return Err(ErrorData::invalid_params(said, None));
        }
    };
    Ok(GetPromptResult::new(vec![PromptMessage::new_text(Role::User, text)]))
}
