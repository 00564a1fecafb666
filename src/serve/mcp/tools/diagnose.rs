//! Diagnosis of a simulation from measured trials.

use std::collections::BTreeMap;

use rmcp::schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::estimate::seconds;
use crate::error::Error;
use crate::serve::mcp::tool::{SideEffect, Tool, ToolCall, ToolResult, tool as declared};
use crate::serve::problem::{HandlerResult, Problem};

pub fn tool() -> Tool {
    declared(
        "diagnose",
        "Diagnose a simulation",
        SideEffect::Records,
        "Finds the effects that a simulation lacks (drag, wind, camera errors, ...) from measured trials, with parameters and \
         intervals; several sets if the data cannot distinguish them, or none if no known effect explains the misfit. Trials are \
         CSV text with a scene or one ball, or the measurements of an exploration. Takes up to minutes and reports progress. \
         Costs no interaction.",
        run,
    )
}

#[derive(Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct DiagnoseArgs {
    /// CSV text with the columns trial, t, body, x, y (s, m), or a track of one ball as exported by tracking software; or several
    /// such texts by name, one trial each. See iplw://docs/formats.
    #[schemars(with = "Option<TrialsArg>")]
    trials: Option<Value>,
    /// The iplw.scene/1 document to compare with; either this or `ball`.
    scene: Option<Map<String, Value>>,
    /// A single ball, instead of a scene.
    ball: Option<BallArg>,
    /// Units, if the trials do not state them.
    reading: Option<ReadingArg>,
    /// Instead of trials and scene: the task or family of propose_actions, to use the trials measured for its proposals.
    explored: Option<String>,
    /// Time limit, s. Default: 300.
    #[schemars(range(min = 1.0, max = 3600.0))]
    seconds: Option<f64>,
}

/// The text of one file, or of several by name.
#[derive(JsonSchema)]
#[schemars(crate = "rmcp::schemars", untagged)]
#[allow(dead_code, reason = "only used for its schema; the operation parses the value")]
enum TrialsArg {
    One(String),
    Several(BTreeMap<String, String>),
}

/// A ball and optionally a floor.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct BallArg {
    /// m
    radius: f64,
    /// kg
    mass: Option<f64>,
    /// m/s^2, downwards. Default: 9.81.
    gravity: Option<f64>,
    /// Height of the floor's surface, m.
    floor: Option<f64>,
}

/// Units, and the track to read.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct ReadingArg {
    /// Frames per second; times are then frame numbers.
    fps: Option<f64>,
    /// m per pixel; coordinates are then in pixels.
    metres_per_pixel: Option<f64>,
    /// m, cm, mm, um, km, in, ft.
    length_unit: Option<String>,
    /// s, ms, us, min.
    time_unit: Option<String>,
    /// Whether y points down, as in images.
    y_down: Option<bool>,
    /// The track or body to read from files with several.
    track: Option<String>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct DiagnoseOutput {
    /// none (the simulation explains the trials), named, ambiguous, unknown or insufficient_data.
    verdict: String,
    /// Reason in a sentence.
    reason: String,
    /// The effects found; of several tied sets, the simplest.
    effects: Vec<EffectFinding>,
    /// All sets of effects that the trials cannot distinguish.
    rivals: Vec<Vec<String>>,
    /// Fraction of the misfit that the effects leave unexplained.
    unexplained_share: Option<f64>,
    /// Recommended experiment to separate rivals or reduce uncertainty; null if there is none.
    next_experiment: Option<NextExperimentInfo>,
    /// The scene with the effects added, an iplw.scene/1 document for roll_out.
    extended_scene: Value,
}

/// A recommended experiment.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct NextExperimentInfo {
    why: String,
    /// The experiment.
    #[serde(rename = "do")]
    action: String,
    /// The rivals that it would separate.
    separates: Vec<String>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct EffectFinding {
    name: String,
    /// p-value, corrected for the search over all effects.
    p_value: f64,
    parameters: Vec<ParameterInfo>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct ParameterInfo {
    name: String,
    value: f64,
    /// 95 % interval; null where unbounded.
    ci95: [Option<f64>; 2],
    unit: String,
}

async fn run(call: ToolCall, args: DiagnoseArgs) -> HandlerResult<ToolResult<DiagnoseOutput>> {
    let seconds = seconds(args.seconds)?;
    let job = match &args.explored {
        None => None,
        Some(explored) => Some(call.session().exploration(explored).ok_or_else(|| {
            let allowed =
                "a task or family with an exploration, as returned by propose_actions in `explored`";
            Problem::from(Error::input("explored", format!("{explored:?}"), allowed))
        })?),
    };
    let request = json!({
        "job": job, "trials": args.trials, "scene": args.scene, "ball": args.ball, "reading": args.reading,
    });
    let done = call.job("start_diagnosis", request, seconds).await?;
    let found: DiagnoseOutput = crate::json::from_value(done.result.ok_or_else(Problem::internal)?)?;
    let mut lines = vec![format!("Verdict: {}. {}", found.verdict, found.reason)];
    lines.extend(found.effects.iter().map(summary));
    if found.rivals.len() > 1 {
        let sets: Vec<String> = found.rivals.iter().map(|set| set.join(" + ")).collect();
        lines.push(format!("Indistinguishable: {}.", sets.join("; ")));
    }
    lines.extend(found.next_experiment.as_ref().map(|next| format!("Next: {} ({})", next.action, next.why)));
    Ok(ToolResult { summary: lines.join("\n"), output: found, picture: None })
}

fn summary(found: &EffectFinding) -> String {
    let parameter = |p: &ParameterInfo| {
        let interval = match p.ci95 {
            [Some(low), Some(high)] => format!(" (95 % {low:.4} to {high:.4})"),
            _ => String::new(),
        };
        format!("{} {:.4} {}{interval}", p.name, p.value, p.unit)
    };
    let all: Vec<String> = found.parameters.iter().map(parameter).collect();
    format!("{}: {}; p {:.2e}.", found.name, all.join(", "), found.p_value)
}
