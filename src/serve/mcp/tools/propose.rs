//! What to measure next, and what is known by now: an exploration that asks, held open as long as the agent is there.

use rmcp::schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::serve::mcp::desk::{Budget, family};
use crate::serve::mcp::show::action_words;
use crate::serve::mcp::tool::{Call, Effect, Job, Known, Told, Tool, known_words, tool as declared};
use crate::serve::problem::{Answer, Problem};

pub fn tool() -> Tool {
    declared(
        "propose_actions",
        "Propose what to measure",
        Effect::Keeps,
        "Proposes the actions whose measurement tells most about the latents, best first, and tells what is known of them by \
         now. Give each proposal's number to `measure`; when all of a round are measured, call this again: the round is \
         fitted, and the next one is proposed with what was learnt. Called before that, it repeats what is open. Costs no \
         interaction.",
        run,
    )
}

#[derive(Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
struct In {
    /// What is explored: a task such as bowling:017, or a family such as bowling, of which training tasks are then chosen.
    task: String,
    /// Proposals a round; 3 if absent. Counts when an exploration begins.
    #[schemars(range(min = 1, max = 20))]
    actions: Option<u64>,
    /// How they are chosen: informative (default; what shrinks the intervals most), mixed, collisions, rolling, random or
    /// gradient; or, a minute or so a round, probing (what tells most) or success (what tells most of whether plans work). Counts when an exploration begins.
    strategy: Option<String>,
    /// Parameters of effects to fit along with the latents, such as linear_drag.c. Counts when an exploration begins.
    fit: Option<Vec<String>>,
    /// Begins anew: what was measured for the proposals before is no longer used.
    anew: Option<bool>,
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Out {
    /// What is explored, as `measure` takes it beside a proposal's number.
    explored: String,
    /// Number of the round, from 0.
    round: u64,
    /// Those that are not measured yet, best first.
    proposals: Vec<Proposal>,
    /// How well each latent will be known once they are measured, if the simulation is right.
    expected: Vec<Expected>,
    /// What the rounds before tell; empty before the first is measured.
    known: Vec<Known>,
    /// Why nothing more is proposed; null while something is.
    ended: Option<String>,
    /// Of the real world of the task's family.
    budget: Budget,
}

#[derive(Clone, Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct Proposal {
    /// Give it to `measure`.
    pub number: u64,
    /// The task it is to be carried out in.
    pub task: String,
    /// Each number from 0 to 1.
    pub action: Vec<f64>,
    /// Why it was chosen, where the strategy says so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    #[serde(default, skip_serializing)]
    #[schemars(skip)]
    pub answered: bool,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
struct Expected {
    /// Of the latent.
    name: String,
    /// Standard deviation now, in its unit.
    before: f64,
    /// Standard deviation then.
    after: f64,
}

/// What is open of an exploration.
#[derive(Deserialize)]
pub struct Open {
    pub round: u64,
    pub proposals: Vec<Proposal>,
}

#[derive(Deserialize)]
struct Course {
    rounds: Vec<Round>,
    next: Option<String>,
}

#[derive(Deserialize)]
struct Round {
    fitted: bool,
    choice: Choice,
    latents: Vec<Known>,
}

#[derive(Deserialize)]
struct Choice {
    expected: Vec<Expected>,
}

/// How long a round may take to be fitted, s.
const PATIENCE: f64 = 300.0;

async fn run(call: Call, asked: In) -> Answer<Told<Out>> {
    let explored = asked.task.clone();
    let job = job(&call, asked).await?;
    let mut stands = call.until(&job, PATIENCE, proposing).await?;
    let budget = call.desk().spent(family(&explored)).await?;
    if budget.remaining == 0 && stands.state == "waiting" && measured(&call, &job).await? {
        // Nothing more will be measured: what was is fitted.
        call.ask("tell_trials", json!({"id": job, "close": true})).await?;
        stands = call.until(&job, PATIENCE, proposing).await?;
    }
    if stands.state == "failed" {
        call.desk().explores(&explored, None);
        return Err(stands.error.unwrap_or_else(Problem::defect));
    }
    let open: Open = call.read("list_proposals", json!({"id": job})).await?;
    let (known, mut expected) = course(&call, &job).await?;
    let ended = match (&stands.result, budget.remaining) {
        (Some(result), _) => Some(format!("the exploration has ended: {}", result["stopped"])),
        (None, 0) => Some("the budget of real interactions is spent".into()),
        (None, _) => None,
    };
    let proposals = match ended {
        Some(_) => Vec::new(),
        None => open.proposals.into_iter().filter(|p| !p.answered).collect(),
    };
    if proposals.is_empty() {
        expected.clear();
    }
    let told = Out { explored, round: open.round, proposals, expected, known, ended, budget };
    Ok(Told { words: words(&told), told, picture: None })
}

fn proposing(job: &Job) -> bool {
    job.state == "waiting" || job.ended()
}

/// The job that proposes; begun if there is none.
async fn job(call: &Call, asked: In) -> Answer<String> {
    let before = call.desk().exploration(&asked.task);
    match before {
        Some(job) if asked.anew != Some(true) => return Ok(job),
        Some(job) => {
            call.desk().explores(&asked.task, None);
            call.desk().give_up(&job).await;
        }
        None => {}
    }
    let wish = json!({
        "task": asked.task, "real": "ask_tell", "rounds": 1000, "actions": asked.actions.unwrap_or(3),
        "strategy": asked.strategy.as_deref().unwrap_or("informative"), "fit": asked.fit,
    });
    let job: Job = call.read("start_iplw", wish).await?;
    call.desk().explores(&asked.task, Some(&job.id));
    Ok(job.id)
}

/// Whether anything of the open round was measured.
async fn measured(call: &Call, job: &str) -> Answer<bool> {
    let open: Open = call.read("list_proposals", json!({"id": job})).await?;
    Ok(open.proposals.iter().any(|p| p.answered))
}

/// What is known after the last round that was fitted, and what the open one is expected to tell.
async fn course(call: &Call, job: &str) -> Answer<(Vec<Known>, Vec<Expected>)> {
    let (mut known, mut expected, mut cursor) = (Vec::new(), Vec::new(), None);
    loop {
        let page: Course =
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

fn words(told: &Out) -> String {
    let mut lines = Vec::new();
    if !told.known.is_empty() {
        lines.push(format!("Known by now: {}.", known_words(&told.known)));
    }
    let why = |p: &Proposal| p.reason.as_ref().map_or(String::new(), |reason| format!("; {reason}"));
    let of =
        |p: &Proposal| format!("proposal {}: {} {}{}", p.number, p.task, action_words(&p.action), why(p));
    lines.extend(told.proposals.iter().map(of));
    let expect = |e: &Expected| format!("{} from {:.3} to {:.3}", e.name, e.before, e.after);
    if !told.expected.is_empty() {
        let all: Vec<String> = told.expected.iter().map(expect).collect();
        lines.push(format!("Standard deviations expected to fall: {}.", all.join(", ")));
    }
    lines.extend(told.ended.as_ref().map(|why| format!("Nothing more is proposed: {why}.")));
    lines.push(told.budget.words());
    lines.join("\n")
}
