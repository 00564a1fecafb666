//! What an agent can read: documentation as resources, and prompts to begin with.

use rmcp::ErrorData;
use rmcp::model::{
    GetPromptResult, JsonObject, Prompt, PromptArgument, PromptMessage, ReadResourceResult, Resource,
    ResourceContents, Role,
};
use serde_json::{Value, json};

use super::tool::Call;

/// Told once, when an agent connects.
pub const INSTRUCTIONS: &str = "\
2D physics worlds with hidden latent factors (density, friction, restitution) and effects. A task is solved by one action: \
numbers from 0 to 1 that place things. roll_out simulates, as often as you like, with latents that you choose; measure acts \
in the real world, whose latents are hidden, and every such interaction is counted against a budget. To calibrate: \
propose_actions, measure each proposal, propose_actions again (it tells what is known by then), and roll_out with those \
latents; or estimate does all of it. Where latents stay unknown or the simulation stays wrong, an effect is missing: diagnose \
says which, from trials or from what was measured for proposals; name its parameters in `fit`. SI units, y up.";

/// A page of documentation, as the program was built with it.
struct Page {
    uri: &'static str,
    name: &'static str,
    about: &'static str,
    text: &'static str,
}

const PAGES: [Page; 2] = [
    Page {
        uri: "iplw://docs/agents",
        name: "agents.md",
        about: "What an agent can do here: tools, budget, tokens, an episode.",
        text: include_str!("../../../docs/agents.md"),
    },
    Page {
        uri: "iplw://docs/formats",
        name: "formats.md",
        about: "Scenes (iplw.scene/1), trials as CSV, tracks of other programs, diagnoses.",
        text: include_str!("../../../docs/formats.md"),
    },
];

/// Where the list of effects is.
const EFFECTS: &str = "iplw://effects";

/// What can be read.
pub fn resources() -> Vec<Resource> {
    let page = |p: &Page| {
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

/// One of them.
pub async fn resource(call: &Call, uri: &str) -> Result<ReadResourceResult, ErrorData> {
    let (text, kind) = match PAGES.iter().find(|p| p.uri == uri) {
        Some(page) => (page.text.to_string(), "text/markdown"),
        None if uri == EFFECTS => {
            let effects = call.ask("list_effects", json!({"limit": 1000})).await;
            let effects = effects.map_err(|problem| ErrorData::internal_error(problem.detail, None))?;
            (effects["effects"].to_string(), "application/json")
        }
        None => {
            let uris: Vec<&str> = PAGES.iter().map(|p| p.uri).chain([EFFECTS]).collect();
            let said = format!("nothing is at {uri}; there are {}", uris.join(", "));
            return Err(ErrorData::resource_not_found(said, None));
        }
    };
    Ok(ReadResourceResult::new(vec![ResourceContents::text(text, uri).with_mime_type(kind)]))
}

const CALIBRATE: &str = "calibrate";
const WRONG: &str = "what_is_wrong";

/// What can be begun with.
pub fn prompts() -> Vec<Prompt> {
    let argument =
        |name: &str, about: &str| PromptArgument::new(name).with_description(about).with_required(true);
    let of_task = argument("task", "Id of the task, such as bowling:017");
    let of_trials = argument("trials", "What was measured, as CSV, or where it is");
    vec![
        Prompt::new(
            CALIBRATE,
            Some("Calibrate a simulation, and solve a task in the real world"),
            Some(vec![of_task]),
        ),
        Prompt::new(
            WRONG,
            Some("Find what a simulation gets wrong about measured trials"),
            Some(vec![of_trials]),
        ),
    ]
}

/// One of them, with its argument put in.
pub fn prompt(name: &str, arguments: Option<&JsonObject>) -> Result<GetPromptResult, ErrorData> {
    let given = |field: &str| {
        let value = arguments.and_then(|a| a.get(field)).and_then(Value::as_str);
        value.ok_or_else(|| ErrorData::invalid_params(format!("`{field}` is missing; allowed: text"), None))
    };
    let text = match name {
        CALIBRATE => format!(
            "Solve the task {} in the real world with as few real interactions as you can. Look at it. Let propose_actions \
             say what to measure, measure those, and propose again until friction and restitution are known well enough. If \
             they stay unknown, let diagnose say which effect the simulation lacks, and begin anew with it in `fit`. Then search by roll_out with those latents and effects for an action that solves the task and still does when it is moved \
             a little, and measure that one. Report the action, the latents with their intervals, and what was spent.",
            given("task")?
        ),
        WRONG => format!(
            "Find what the simulation gets wrong about these trials: {}\nRead iplw://docs/formats for the columns. Diagnose \
             them against their scene, or against one ball of the right radius. Report the verdict with its reason, the \
             effects with their intervals, the rivals that the data cannot tell apart, and the next experiment if one is \
             advised. If the verdict is that too little was measured, say what is needed.",
            given("trials")?
        ),
        _ => {
            let said = format!("no prompt {name:?}; there are {CALIBRATE} and {WRONG}");
            return Err(ErrorData::invalid_params(said, None));
        }
    };
    Ok(GetPromptResult::new(vec![PromptMessage::new_text(Role::User, text)]))
}
