//! What a simulation gets wrong about measured trials.

use std::collections::BTreeMap;

use rmcp::schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::estimate::seconds;
use crate::error::Error;
use crate::serve::mcp::tool::{Call, Effect, Told, Tool, tool as declared};
use crate::serve::problem::{Answer, Problem};

pub fn tool() -> Tool {
    declared(
        "diagnose",
        "Diagnose a simulation",
        Effect::Keeps,
        "Says what a simulation gets wrong, from measured trials: the effect that is missing (drag, wind, a camera's error, \
         ...) with its parameters and intervals, several if the data cannot tell them apart, or that nothing known explains \
         the misfit. Trials are CSV text against a scene or one ball, or what was measured for an exploration. Takes up to \
         minutes and tells how far it is. Costs no interaction.",
        run,
    )
}

#[derive(Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct In {
    /// CSV text with the columns trial, t, body, x, y (s, m), or a track of one ball as tracking programs write it; or several
    /// such texts by name, a trial each. iplw://docs/formats tells more.
    #[schemars(with = "Option<Trials>")]
    trials: Option<Value>,
    /// The iplw.scene/1 document that is held against them; this or `ball`.
    scene: Option<Map<String, Value>>,
    /// Instead of a scene, where one ball flies.
    ball: Option<Ball>,
    /// Units, where the trials do not say.
    reading: Option<Reading>,
    /// Instead of trials and scene: what propose_actions was given; the trials measured for its proposals are diagnosed.
    explored: Option<String>,
    /// Longest it may take, s; 300 if absent. Then it is given up.
    #[schemars(range(min = 1.0, max = 3600.0))]
    seconds: Option<f64>,
}

/// The text of a file, or of several by name.
#[derive(JsonSchema)]
#[schemars(crate = "rmcp::schemars", untagged)]
#[allow(dead_code, reason = "the operation reads them; this says how they look")]
enum Trials {
    One(String),
    Several(BTreeMap<String, String>),
}

/// A ball, and a floor if there is one.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct Ball {
    /// m
    radius: f64,
    /// kg
    mass: Option<f64>,
    /// m/s^2, downwards; 9.81 if absent.
    gravity: Option<f64>,
    /// Height of the floor's surface, m.
    floor: Option<f64>,
}

/// Units, and the track to read.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct Reading {
    /// Pictures a second: times are numbers of pictures.
    fps: Option<f64>,
    /// m: coordinates are in pixels.
    metres_per_pixel: Option<f64>,
    /// m, cm, mm, um, km, in, ft.
    length_unit: Option<String>,
    /// s, ms, us, min.
    time_unit: Option<String>,
    /// Whether y is counted downwards, as in pictures.
    y_down: Option<bool>,
    /// Which track, or body, of files that hold several.
    track: Option<String>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Out {
    /// none (the simulation explains the trials), named, ambiguous, unknown or insufficient_data.
    verdict: String,
    /// Why, in a sentence.
    reason: String,
    /// The effects that were found; of several sets that tie, the simplest.
    effects: Vec<Found>,
    /// Every set of effects that the trials cannot tell from that one.
    rivals: Vec<Vec<String>>,
    /// Share of the misfit that the effects leave.
    unexplained_share: Option<f64>,
    /// What would tell rivals apart, or make more of it known; null if nothing is advised.
    next_experiment: Option<Next>,
    /// The scene with what was found, an iplw.scene/1 document that roll_out takes.
    extended_scene: Value,
}

/// An experiment that would tell more.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Next {
    why: String,
    /// What to do.
    #[serde(rename = "do")]
    action: String,
    /// What it would tell apart.
    separates: Vec<String>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Found {
    name: String,
    /// Corrected for the search over all effects.
    p_value: f64,
    parameters: Vec<Parameter>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Parameter {
    name: String,
    value: f64,
    /// Its 95 % interval; null where the trials set no bound.
    ci95: [Option<f64>; 2],
    unit: String,
}

async fn run(call: Call, asked: In) -> Answer<Told<Out>> {
    let seconds = seconds(asked.seconds)?;
    let job = match &asked.explored {
        None => None,
        Some(explored) => Some(call.desk().exploration(explored).ok_or_else(|| {
            let allowed = "what propose_actions was given before: it tells it as `explored`";
            Problem::from(Error::input("explored", format!("{explored:?}"), allowed))
        })?),
    };
    let wish = json!({
        "job": job, "trials": asked.trials, "scene": asked.scene, "ball": asked.ball, "reading": asked.reading,
    });
    let done = call.job("start_diagnosis", wish, seconds).await?;
    let found: Out = crate::json::from_value(done.result.ok_or_else(Problem::defect)?)?;
    let mut lines = vec![format!("Verdict: {}. {}", found.verdict, found.reason)];
    lines.extend(found.effects.iter().map(words));
    if found.rivals.len() > 1 {
        let sets: Vec<String> = found.rivals.iter().map(|set| set.join(" + ")).collect();
        lines.push(format!("Not told apart: {}.", sets.join("; ")));
    }
    lines.extend(found.next_experiment.as_ref().map(|next| format!("Next: {} ({})", next.action, next.why)));
    Ok(Told { words: lines.join("\n"), told: found, picture: None })
}

fn words(found: &Found) -> String {
    let parameter = |p: &Parameter| {
        let interval = match p.ci95 {
            [Some(low), Some(high)] => format!(" (95 % {low:.4} to {high:.4})"),
            _ => String::new(),
        };
        format!("{} {:.4} {}{interval}", p.name, p.value, p.unit)
    };
    let all: Vec<String> = found.parameters.iter().map(parameter).collect();
    format!("{}: {}; p {:.2e}.", found.name, all.join(", "), found.p_value)
}
