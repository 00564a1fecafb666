//! Proposals of actions to measure: an ask-tell estimation, kept open during the agent's session.

use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::ToSchema;

use crate::estimate::LatentEstimate;
use crate::explore::ExpectedPosteriorSd;
use crate::serve::mcp::agent_session::{InteractionBudget, family};
use crate::serve::mcp::describe::format_action;
use crate::serve::mcp::tool::{
    JobInfo, SideEffect, Tool, ToolCall, ToolResult, describe_latents, tool as declared,
};
use crate::serve::problem::{HandlerResult, Problem};
use crate::serve::wire::RoundOut;
use crate::store::JobState;

pub fn tool() -> Tool {
    declared(
        "propose_actions",
        "Propose what to measure",
        SideEffect::Records,
        "Proposes the most informative actions about the latents, best first, and returns the estimates so far. Pass each \
         proposal's number to `measure`; when all of a round are measured, call this again: it fits the round and proposes the \
         next. Before that, it repeats the open proposals. Costs no interaction.",
        run,
    )
}

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct ProposeArgs {
    /// Task to explore, such as bowling:017, or a family such as bowling, to explore its training tasks.
    task: String,
    /// Proposals per round. Default: 3. Only used when an exploration starts.
    #[schema(minimum = 1, maximum = 20)]
    actions: Option<u64>,
    /// How to choose actions: informative (default; shrinks the intervals most), mixed, collisions, rolling, random or gradient;
    /// or, taking about a minute per round, probing (most information on parameters) or success (on whether plans work). Only used
    /// when an exploration starts.
    strategy: Option<String>,
    /// Effect parameters to estimate together with the latents, such as linear_drag.c. Only used when an exploration starts.
    fit: Option<Vec<String>>,
    /// Starts a new exploration and discards earlier measurements.
    anew: Option<bool>,
}

#[derive(Serialize, ToSchema)]
struct ProposeOutput {
    /// The explored task or family, as `task` of `measure`.
    explored: String,
    /// Number of the round, from 0.
    round: u64,
    /// Open proposals, best first.
    proposals: Vec<ProposalInfo>,
    /// Expected uncertainty of each latent after the round, if the simulation is correct.
    expected: Vec<ExpectedPosteriorSd>,
    /// Estimates after the last fitted round; empty before the first.
    known: Vec<LatentEstimate>,
    /// Why there are no more proposals; null while there are.
    ended: Option<String>,
    /// Budget of the family's real world.
    budget: InteractionBudget,
}

#[derive(Clone, Serialize, Deserialize, ToSchema)]
pub struct ProposalInfo {
    /// Pass it to `measure`.
    pub number: u64,
    /// Id of the task.
    pub task: String,
    /// Components from 0 to 1.
    pub action: Vec<f64>,
    /// Why it was chosen, if the strategy gives reasons.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    #[serde(default, skip_serializing)]
    #[schema(ignore)]
    pub answered: bool,
}

/// The open round of an exploration.
#[derive(Deserialize)]
pub struct OpenRound {
    pub round: u64,
    pub proposals: Vec<ProposalInfo>,
}

#[derive(Deserialize)]
struct HistoryPage {
    rounds: Vec<RoundOut>,
    next: Option<String>,
}

/// Time limit for fitting a round, s.
const MAX_FIT_S: f64 = 300.0;

async fn run(call: ToolCall, args: ProposeArgs) -> HandlerResult<ToolResult<ProposeOutput>> {
    let explored = args.task.clone();
    let job = job(&call, args).await?;
    let mut current = call.until(&job, MAX_FIT_S, proposing).await?;
    let budget = call.session().spent(family(&explored)).await?;
    if budget.remaining == 0 && current.state == JobState::Waiting && measured(&call, &job).await? {
        // No more can be measured: close the round to fit what was measured.
        call.ask("submit_trials", json!({"id": job, "close": true})).await?;
        current = call.until(&job, MAX_FIT_S, proposing).await?;
    }
    if current.state == JobState::Failed {
        call.session().set_exploration(&explored, None);
        return Err(current.error.unwrap_or_else(Problem::internal));
    }
    let open: OpenRound = call.read("list_proposals", json!({"id": job})).await?;
    let (known, mut expected) = history(&call, &job).await?;
    let ended = match (&current.result, budget.remaining) {
        (Some(result), _) => Some(format!("the exploration has ended: {}", result["stopped"])),
        (None, 0) => Some("the budget of real interactions is exhausted".into()),
        (None, _) => None,
    };
    let proposals = match ended {
        Some(_) => Vec::new(),
        None => open.proposals.into_iter().filter(|p| !p.answered).collect(),
    };
    if proposals.is_empty() {
        expected.clear();
    }
    let output = ProposeOutput { explored, round: open.round, proposals, expected, known, ended, budget };
    Ok(ToolResult { summary: summary(&output), output, picture: None })
}

fn proposing(job: &JobInfo) -> bool {
    job.state == JobState::Waiting || job.state.ended()
}

/// The job that proposes, started if there is none.
async fn job(call: &ToolCall, args: ProposeArgs) -> HandlerResult<String> {
    let before = call.session().exploration(&args.task);
    match before {
        Some(job) if args.anew != Some(true) => return Ok(job),
        Some(job) => {
            call.session().set_exploration(&args.task, None);
            call.session().cancel_job(&job).await;
        }
        None => {}
    }
    let request = json!({
        "task": args.task, "real": "ask_tell", "rounds": 1000, "actions": args.actions.unwrap_or(3),
        "strategy": args.strategy.as_deref().unwrap_or("informative"), "fit": args.fit,
    });
    let job: JobInfo = call.read("start_iplw", request).await?;
    call.session().set_exploration(&args.task, Some(&job.id));
    Ok(job.id)
}

/// Whether the open round has measurements.
async fn measured(call: &ToolCall, job: &str) -> HandlerResult<bool> {
    let open: OpenRound = call.read("list_proposals", json!({"id": job})).await?;
    Ok(open.proposals.iter().any(|p| p.answered))
}

/// Estimates after the last fitted round, and expectations of the open one.
async fn history(
    call: &ToolCall,
    job: &str,
) -> HandlerResult<(Vec<LatentEstimate>, Vec<ExpectedPosteriorSd>)> {
    let (mut known, mut expected, mut cursor) = (Vec::new(), Vec::new(), None);
    loop {
        let page: HistoryPage =
            call.read("list_rounds", json!({"id": job, "limit": 1000, "cursor": cursor})).await?;
        for round in page.rounds {
            match round.fitted {
                true => known = round.latents,
                false => expected = round.choice.expected,
            }
        }
        cursor = page.next;
        if cursor.is_none() {
            return Ok((known, expected));
        }
    }
}

fn summary(output: &ProposeOutput) -> String {
    let mut lines = Vec::new();
    if !output.known.is_empty() {
        lines.push(format!("Estimates so far: {}.", describe_latents(&output.known)));
    }
    let why = |p: &ProposalInfo| p.reason.as_ref().map_or(String::new(), |reason| format!("; {reason}"));
    let of = |p: &ProposalInfo| {
        format!("proposal {}: {} {}{}", p.number, p.task, format_action(&p.action), why(p))
    };
    lines.extend(output.proposals.iter().map(of));
    let expect = |e: &ExpectedPosteriorSd| format!("{} from {:.3} to {:.3}", e.name, e.before, e.after);
    if !output.expected.is_empty() {
        let all: Vec<String> = output.expected.iter().map(expect).collect();
        lines.push(format!("Standard deviations expected to fall: {}.", all.join(", ")));
    }
    lines.extend(output.ended.as_ref().map(|why| format!("No more proposals: {why}.")));
    lines.push(output.budget.summary());
    lines.join("\n")
}
