//! Diagnosis of a simulation from measured trials.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;

use super::estimate::seconds;
use crate::commands::TrialFiles;
use crate::inference::report::{EffectEstimate, ParameterEstimate, RecommendedExperiment, Verdict};
use crate::reality::TrackParseOptions;
use crate::serve::mcp::tool::{SideEffect, Tool, ToolCall, ToolResult, tool as declared};
use crate::serve::problem::HandlerResult;
use crate::task::ball::BallScene;

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

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct DiagnoseArgs {
    /// CSV text with the columns trial, t, body, x, y (s, m), or a track of one ball as exported by tracking software; or several
    /// such texts by name, one trial each. See iplw://docs/formats.
    #[schema(value_type = Option<TrialFiles>)]
    trials: Option<Value>,
    /// The iplw.scene/1 document to compare with; either this or `ball`.
    #[schema(value_type = Option<Object>)]
    scene: Option<Value>,
    /// A single ball, instead of a scene.
    #[schema(value_type = Option<BallScene>)]
    ball: Option<Value>,
    /// Units, if the trials do not state them.
    #[schema(value_type = Option<TrackParseOptions>)]
    reading: Option<Value>,
    /// Instead of trials and scene: the task or family of propose_actions, to use the trials measured for its proposals.
    explored: Option<String>,
    /// Time limit, s. Default: 300.
    #[schema(minimum = 1, maximum = 3600)]
    seconds: Option<f64>,
}

#[derive(Serialize, Deserialize, ToSchema)]
struct DiagnoseOutput {
    /// none (the simulation explains the trials), named, ambiguous, unknown or insufficient_data.
    verdict: Verdict,
    /// Reason in a sentence.
    reason: String,
    /// The effects found; of several tied sets, the simplest.
    effects: Vec<EffectEstimate>,
    /// All sets of effects that the trials cannot distinguish.
    rivals: Vec<Vec<String>>,
    /// Fraction of the misfit that the effects leave unexplained.
    unexplained_share: Option<f64>,
    /// Recommended experiment to separate rivals or reduce uncertainty; null if there is none.
    next_experiment: Option<RecommendedExperiment>,
    /// The scene with the effects added, an iplw.scene/1 document for roll_out.
    #[schema(value_type = Object)]
    extended_scene: Value,
}

async fn run(call: ToolCall, args: DiagnoseArgs) -> HandlerResult<ToolResult<DiagnoseOutput>> {
    let seconds = seconds(args.seconds)?;
    let exploration = |explored| call.session().require_exploration("explored", explored);
    let job = args.explored.as_deref().map(exploration).transpose()?;
    let request = json!({
        "job": job, "trials": args.trials, "scene": args.scene, "ball": args.ball, "reading": args.reading,
    });
    let found: DiagnoseOutput = call.job("start_diagnosis", request, seconds).await?;
    let mut lines = vec![format!("Verdict: {}. {}", found.verdict.name(), found.reason)];
    lines.extend(found.effects.iter().map(summary));
    if found.rivals.len() > 1 {
        let sets: Vec<String> = found.rivals.iter().map(|set| set.join(" + ")).collect();
        lines.push(format!("Indistinguishable: {}.", sets.join("; ")));
    }
    lines.extend(found.next_experiment.as_ref().map(|next| format!("Next: {} ({})", next.action, next.why)));
    Ok(ToolResult { summary: lines.join("\n"), output: found, picture: None })
}

fn summary(found: &EffectEstimate) -> String {
    let parameter = |p: &ParameterEstimate| {
        let interval = match p.ci95 {
            [Some(low), Some(high)] => format!(" (95 % {low:.4} to {high:.4})"),
            _ => String::new(),
        };
        format!("{} {:.4} {}{interval}", p.name, p.value, p.unit)
    };
    let all: Vec<String> = found.parameters.iter().map(parameter).collect();
    format!("{}: {}; probability {:.2}.", found.name, all.join(", "), found.probability)
}
