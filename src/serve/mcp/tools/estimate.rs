//! Estimation of the real world's latents in one call.

use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::ToSchema;

use crate::estimate::LatentEstimate;
use crate::serve::mcp::agent_session::{InteractionBudget, family};
use crate::serve::mcp::tool::{SideEffect, Tool, ToolCall, ToolResult, describe_latents, tool as declared};
use crate::serve::problem::HandlerResult;

pub fn tool() -> Tool {
    declared(
        "estimate",
        "Estimate latents",
        SideEffect::SpendsInteractions,
        "Estimates the latents of the real world of a task's family, in rounds of exploring, measuring and fitting. Its real \
         interactions count against the budget like those of `measure`, also if the call is cancelled. Takes seconds to minutes \
         and reports progress. For more control use propose_actions and measure.",
        run,
    )
}

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct EstimateArgs {
    /// A family such as bowling (its training tasks are explored), or one task such as bowling:017.
    task: String,
    /// Maximum number of rounds. Default: 3.
    #[schema(minimum = 1, maximum = 50)]
    rounds: Option<u64>,
    /// Real interactions per round. Default: 4.
    #[schema(minimum = 1, maximum = 50)]
    actions: Option<u64>,
    /// How to choose actions: informative (default), mixed, collisions, rolling, random or gradient; or, taking about a minute per
    /// round, probing (most information on parameters) or success (on whether plans work).
    strategy: Option<String>,
    /// Effect parameters to estimate together with the latents, such as linear_drag.c.
    fit: Option<Vec<String>>,
    /// How to compare simulation and measurement: trajectory (default) or shooting, which is robust to noise and chaos.
    residual: Option<String>,
    /// Random seed. Default: 0.
    seed: Option<u64>,
    /// Time limit, s. Default: 300.
    #[schema(minimum = 1, maximum = 3600)]
    seconds: Option<f64>,
}

#[derive(Serialize, ToSchema)]
struct EstimateOutput {
    /// Estimates of the latents and of free effect parameters.
    latents: Vec<LatentEstimate>,
    /// Real interactions used by this call.
    real_interactions: u64,
    /// Stop reason: `rounds`, `settled` or `budget`.
    stopped: String,
    /// Budget of this real world.
    budget: InteractionBudget,
}

#[derive(Deserialize)]
struct EstimationResult {
    latents: Vec<LatentEstimate>,
    /// Free effect parameters.
    effects: Vec<LatentEstimate>,
    real_interactions: u64,
    stopped: String,
}

async fn run(call: ToolCall, args: EstimateArgs) -> HandlerResult<ToolResult<EstimateOutput>> {
    let seconds = seconds(args.seconds)?;
    let (world, _) = call.session().real_world(family(&args.task)).await?;
    let request = json!({
        "task": args.task, "world": world, "rounds": args.rounds.unwrap_or(3), "actions": args.actions.unwrap_or(4),
        "strategy": args.strategy.as_deref().unwrap_or("informative"), "fit": args.fit, "residual": args.residual,
        "seed": args.seed,
    });
    let found: EstimationResult = call.job("start_iplw", request, seconds).await?;
    let (_, budget) = call.session().real_world(family(&args.task)).await?;
    let EstimationResult { mut latents, effects, real_interactions, stopped } = found;
    latents.extend(effects);
    let summary = format!(
        "Estimates from {} real interactions: {}. Stop reason: {stopped}. {}",
        real_interactions,
        describe_latents(&latents),
        budget.summary()
    );
    Ok(ToolResult {
        summary,
        output: EstimateOutput { latents, real_interactions, stopped, budget },
        picture: None,
    })
}

/// Validates the time limit of a job, s.
pub fn seconds(args: Option<f64>) -> HandlerResult<f64> {
    Ok(args.map_or(Ok(300.0), |s| crate::error::check_range("seconds", s, 1.0, 3600.0))?)
}
