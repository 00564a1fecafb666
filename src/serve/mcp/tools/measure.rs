//! One real interaction, counted.

use std::collections::BTreeMap;

use rmcp::schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::propose::{Open, Proposal};
use super::roll_out::scene_of;
use crate::error::Error;
use crate::serve::mcp::desk::{Budget, family};
use crate::serve::mcp::show::{Path, Rolled, action_words};
use crate::serve::mcp::tool::{Call, Effect, Told, Tool, tool as declared};
use crate::serve::problem::Answer;

pub fn tool() -> Tool {
    declared(
        "measure",
        "Measure in the real world",
        Effect::Spends,
        "Carries out one action in the real world of the task's family, whose latents are hidden, and tells what was seen, with \
         a film of it. It costs one real interaction of the budget; an action that cannot be placed costs none. With the \
         number of a proposal, what was measured is told to the exploration.",
        run,
    )
}

#[derive(Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct In {
    /// Id of the task, such as bowling:017; beside a proposal, what propose_actions was given (`explored`).
    task: String,
    /// Numbers from 0 to 1, one for each component; this or `proposal`.
    action: Option<Vec<f64>>,
    /// Number of a proposal of propose_actions, to be carried out as it was proposed.
    proposal: Option<u64>,
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Out {
    /// Id of the task it was carried out in.
    task: String,
    action: Vec<f64>,
    /// Why it cannot be placed; null if it was carried out.
    reason: Option<String>,
    /// Whether the goal was reached; null if nothing was carried out.
    solved: Option<bool>,
    /// How long it was observed, s.
    seconds: f64,
    /// What was seen: by body rows of [t in s, x in m, y in m].
    paths: BTreeMap<String, Path>,
    /// Proposals of the round that are still open; null without `proposal`.
    open: Option<u64>,
    /// Of this real world.
    budget: Budget,
}

#[derive(Deserialize)]
struct Batch {
    interactions: u64,
    results: Vec<Value>,
}

#[derive(Deserialize)]
struct Answered {
    open: u64,
}

async fn run(call: Call, asked: In) -> Answer<Told<Out>> {
    let (job, Proposal { task, action, number, .. }) = meant(&call, asked).await?;
    let (world, _) = call.desk().real_world(family(&task)).await?;
    let wish = json!({"id": world, "task": task, "actions": [action], "trajectories": true});
    let batch: Batch = call.read("rollout_world", wish).await?;
    let budget = call.desk().note(family(&task), batch.interactions).await;
    let measured = batch.results.into_iter().next().unwrap_or_default();
    let open = match job {
        Some(job) => Some(tell(&call, &job, number, &measured).await?),
        None => None,
    };
    let rolled: Rolled = crate::json::from_value(measured)?;
    let mut said = format!("{task} {}, measured: {}.", action_words(&action), rolled.words());
    match open {
        Some(0) => said += " The round is complete: propose_actions tells what is known now.",
        Some(n) => said += &format!(" Open in the round: {n}."),
        None => {}
    }
    said = format!("{said} {}", budget.words());
    let told = Out {
        reason: rolled.reason.clone(),
        solved: rolled.solved,
        seconds: rolled.t.last().copied().unwrap_or(0.0),
        paths: rolled.paths(),
        open,
        budget,
        task,
        action,
    };
    let picture = match told.reason {
        Some(_) => None,
        None => Some(rolled.film(scene_of(&call, &told.task).await?, Some(told.action.clone())).await?),
    };
    Ok(Told { words: said, told, picture })
}

/// What is to be carried out, and the job that proposed it.
async fn meant(call: &Call, asked: In) -> Answer<(Option<String>, Proposal)> {
    let In { task, action, proposal } = asked;
    let number = match (action, proposal) {
        (Some(action), None) => {
            return Ok((None, Proposal { number: 0, task, action, reason: None, answered: false }));
        }
        (None, Some(number)) => number,
        (Some(_), Some(_)) => {
            return Err(Error::input("proposal", "given beside action", "one of the two").into());
        }
        (None, None) => {
            return Err(Error::input("action", "missing", "an action, or the number of a proposal").into());
        }
    };
    let Some(job) = call.desk().exploration(&task) else {
        let allowed = "what propose_actions was given before: it tells it as `explored`";
        return Err(Error::input("task", format!("{task:?}"), allowed).into());
    };
    let open: Open = call.read("list_proposals", json!({"id": job})).await?;
    let (left, mut meant): (Vec<Proposal>, Vec<Proposal>) =
        open.proposals.into_iter().filter(|p| !p.answered).partition(|p| p.number != number);
    match meant.pop() {
        Some(proposal) => Ok((Some(job), proposal)),
        None => {
            let open: Vec<String> = left.iter().map(|p| p.number.to_string()).collect();
            let allowed = format!("the number of an open proposal: {}", open.join(", "));
            Err(Error::input("proposal", number, allowed).into())
        }
    }
}

/// Tells the exploration; how many proposals of the round are still open.
async fn tell(call: &Call, job: &str, number: u64, measured: &Value) -> Answer<u64> {
    let news = match measured["valid"].as_bool() {
        Some(true) => {
            let trial = json!({"proposal": number, "t": measured["t"], "bodies": measured["bodies"]});
            json!({"id": job, "trials": [trial]})
        }
        _ => json!({"id": job, "failed": [number]}),
    };
    let told: Answered = call.read("tell_trials", news).await?;
    Ok(told.open)
}
