//! One real interaction, counted.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;

use super::propose::{OpenRound, ProposalInfo};
use crate::error::Error;
use crate::serve::mcp::agent_session::{InteractionBudget, family};
use crate::serve::mcp::describe::{RolloutTrajectory, format_action};
use crate::serve::mcp::tool::{SideEffect, Tool, ToolCall, ToolResult, tool as declared};
use crate::serve::problem::{HandlerResult, Problem};

pub fn tool() -> Tool {
    declared(
        "measure",
        "Measure in the real world",
        SideEffect::SpendsInteractions,
        "Carries out one action in the real world of the task's family, whose latents are hidden, and returns the observed \
         trajectory with a filmstrip. Costs one real interaction; an action that cannot be placed costs none. With the number of a \
         proposal, submits the measurement to the exploration.",
        run,
    )
}

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct MeasureArgs {
    /// Id of the task, such as bowling:017; with `proposal`, the `explored` of propose_actions.
    task: String,
    /// Numbers from 0 to 1, one per component; either this or `proposal`.
    action: Option<Vec<f64>>,
    /// Number of a proposal of propose_actions to carry out.
    proposal: Option<u64>,
}

#[derive(Serialize, ToSchema)]
struct MeasureOutput {
    /// Id of the task.
    task: String,
    action: Vec<f64>,
    /// Why it cannot be placed; null if it was carried out.
    reason: Option<String>,
    /// Whether the goal was reached; null if nothing was carried out.
    solved: Option<bool>,
    /// Observed duration, s.
    seconds: f64,
    /// Observed paths by body: rows [t in s, x in m, y in m].
    paths: BTreeMap<String, Vec<[f64; 3]>>,
    /// Open proposals of the round; null without `proposal`.
    open: Option<u64>,
    /// Budget of this real world.
    budget: InteractionBudget,
}

#[derive(Deserialize)]
struct RolloutResponse {
    interactions: u64,
    results: Vec<Value>,
}

async fn run(call: ToolCall, args: MeasureArgs) -> HandlerResult<ToolResult<MeasureOutput>> {
    let (job, ProposalInfo { task, action, number, .. }) = resolve_action(&call, args).await?;
    let (world, _) = call.session().real_world(family(&task)).await?;
    let request = json!({"id": world, "task": task, "actions": [action], "trajectories": true});
    let batch: RolloutResponse = call.read("rollout_world", request).await?;
    let budget = call.session().record_interactions(family(&task), batch.interactions).await;
    let measured = batch.results.into_iter().next().unwrap_or_default();
    let open = match job {
        Some(job) => Some(submit(&call, &job, number, &measured).await?),
        None => None,
    };
    let rolled: RolloutTrajectory = crate::json::from_value(measured)?;
    let mut message = format!("{task} {}, measured: {}.", format_action(&action), rolled.summary());
    match open {
        Some(0) => message += " The round is complete: propose_actions returns the new estimates.",
        Some(n) => message += &format!(" Open in the round: {n}."),
        None => {}
    }
    message = format!("{message} {}", budget.summary());
    let output = MeasureOutput {
        reason: rolled.reason.clone(),
        solved: rolled.solved,
        seconds: rolled.t.last().copied().unwrap_or(0.0),
        paths: rolled.paths(),
        open,
        budget,
        task,
        action,
    };
    let picture = match output.reason {
        Some(_) => None,
        None => {
            let scene = call.task(&output.task).await?.scene;
            Some(rolled.filmstrip(scene, Some(output.action.clone())).await?)
        }
    };
    Ok(ToolResult { summary: message, output, picture })
}

/// The action to carry out, and the job that proposed it.
async fn resolve_action(call: &ToolCall, args: MeasureArgs) -> HandlerResult<(Option<String>, ProposalInfo)> {
    let MeasureArgs { task, action, proposal } = args;
    let number = match (action, proposal) {
        (Some(action), None) => {
            return Ok((None, ProposalInfo { number: 0, task, action, reason: None, answered: false }));
        }
        (None, Some(number)) => number,
        (Some(_), Some(_)) => {
            return Err(Error::input("proposal", "given together with action", "one of the two").into());
        }
        (None, None) => {
            return Err(Error::input("action", "missing", "an action, or the number of a proposal").into());
        }
    };
    let job = call.session().require_exploration("task", &task)?;
    let open: OpenRound = call.read("list_proposals", json!({"id": job})).await?;
    let (left, mut matching): (Vec<ProposalInfo>, Vec<ProposalInfo>) =
        open.proposals.into_iter().filter(|p| !p.answered).partition(|p| p.number != number);
    match matching.pop() {
        Some(proposal) => Ok((Some(job), proposal)),
        None => {
            let open: Vec<String> = left.iter().map(|p| p.number.to_string()).collect();
            let allowed = format!("the number of an open proposal: {}", open.join(", "));
            Err(Error::input("proposal", number, allowed).into())
        }
    }
}

/// Submits the measurement to the exploration and returns the number of open proposals.
async fn submit(call: &ToolCall, job: &str, number: u64, measured: &Value) -> HandlerResult<u64> {
    let submission = match measured["valid"].as_bool() {
        Some(true) => {
            let trial = json!({"proposal": number, "t": measured["t"], "bodies": measured["bodies"]});
            json!({"id": job, "trials": [trial]})
        }
        _ => json!({"id": job, "failed": [number]}),
    };
    let status: Value = call.read("submit_trials", submission).await?;
    status["open"].as_u64().ok_or_else(Problem::internal)
}
