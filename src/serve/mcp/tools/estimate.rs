//! The latents of the real world, estimated in one call.

use rmcp::schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::serve::mcp::desk::{Budget, family};
use crate::serve::mcp::tool::{Call, Effect, Known, Told, Tool, known_words, tool as declared};
use crate::serve::problem::{Answer, Problem};

pub fn tool() -> Tool {
    declared(
        "estimate",
        "Estimate latents",
        Effect::Spends,
        "Explores, measures and fits by itself: estimates the latents of the real world of a task's family in rounds of real \
         interactions, which count against the budget like those of `measure`. Takes seconds to minutes and tells how far it \
         is; cancelled, it stops, and what was measured by then is spent. Use propose_actions and measure to stay in charge.",
        run,
    )
}

#[derive(Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct In {
    /// A family such as bowling, whose training tasks are explored, or one task such as bowling:017.
    task: String,
    /// Most rounds of exploring, measuring and fitting; 3 if absent.
    #[schemars(range(min = 1, max = 50))]
    rounds: Option<u64>,
    /// Real interactions a round; 4 if absent.
    #[schemars(range(min = 1, max = 50))]
    actions: Option<u64>,
    /// How actions are chosen: informative (default), mixed, collisions, rolling, random or gradient; or, a minute or so a round, probing
    /// (what tells most) or success (what tells most of whether plans work).
    strategy: Option<String>,
    /// Parameters of effects to fit along with the latents, such as linear_drag.c.
    fit: Option<Vec<String>>,
    /// How simulation and measurement are compared: trajectory (default) or shooting, which bears noise and chance.
    residual: Option<String>,
    /// Seed of its random numbers; 0 if absent.
    seed: Option<u64>,
    /// Longest it may take, s; 300 if absent. Then it is given up.
    #[schemars(range(min = 1.0, max = 3600.0))]
    seconds: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Out {
    /// What the trials tell of each latent, and of each parameter fitted along.
    latents: Vec<Known>,
    /// Spent by this call.
    real_interactions: u64,
    /// Why it stopped: `rounds`, `settled` or `budget`.
    stopped: String,
    /// Of this real world.
    budget: Budget,
}

#[derive(Deserialize)]
struct Report {
    latents: Vec<Known>,
    /// Parameters fitted along.
    effects: Vec<Known>,
    real_interactions: u64,
    stopped: String,
}

async fn run(call: Call, asked: In) -> Answer<Told<Out>> {
    let seconds = seconds(asked.seconds)?;
    let (world, _) = call.desk().real_world(family(&asked.task)).await?;
    let wish = json!({
        "task": asked.task, "world": world, "rounds": asked.rounds.unwrap_or(3), "actions": asked.actions.unwrap_or(4),
        "strategy": asked.strategy.as_deref().unwrap_or("informative"), "fit": asked.fit, "residual": asked.residual,
        "seed": asked.seed,
    });
    let done = call.job("start_iplw", wish, seconds).await?;
    let found: Report = crate::json::from_value(done.result.ok_or_else(Problem::defect)?)?;
    let (_, budget) = call.desk().real_world(family(&asked.task)).await?;
    let Report { mut latents, effects, real_interactions, stopped } = found;
    latents.extend(effects);
    let words = format!(
        "{} real interactions tell: {}. Stopped by: {stopped}. {}",
        real_interactions,
        known_words(&latents),
        budget.words()
    );
    Ok(Told { words, told: Out { latents, real_interactions, stopped, budget }, picture: None })
}

/// How long a job may take, s.
pub fn seconds(asked: Option<f64>) -> Answer<f64> {
    Ok(asked.map_or(Ok(300.0), |s| crate::error::within("seconds", s, 1.0, 3600.0))?)
}
