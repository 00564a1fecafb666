//! Learning on in a world: random attempts on its training tasks, then further batches for a policy. From the policy
//! [`UNTRAINED`] this is direct learning, the baseline without a simulation. Begun again, the job makes no attempt twice.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::attempts::Attempts;
use super::estimation::explored;
use super::stored::{UNTRAINED, began_with, free_id, load, of_policy, row};
use super::text::json;
use crate::error::{Error, Result};
use crate::experiment::transfer::LearnConfig;
use crate::explore;
use crate::job::{Context, New, Outcome, Work};
use crate::json::from_value;
use crate::policy::{Dataset, Dqn, Example, Policy, TrainConfig};
use crate::progress::Progress;
use crate::rng;
use crate::serve::app::App;
use crate::serve::operation::{ACT, Id, Keep, Kept, Operation, post};
use crate::serve::shared::Base;
use crate::serve::wire::{JobOut, LearnIn};
use crate::session::World;
use crate::store::PolicyRow;
use crate::task::{Task, ValidAction};

/// Learning in a world.
pub fn operations() -> Vec<Operation> {
    vec![
        post("learn_policy", "/v1/policies/{id}/learn", "policies", ACT)
            .about(
                "Lets a policy learn on in a world, from random attempts on its training tasks. A job; its result \
                 names the new\npolicy. From the policy `untrained`, which is always there, this is direct learning: \
                 no simulation.",
            )
            .refuses(&[(404, "Unknown policy or world"), (409, "`random`, which cannot learn")])
            .queues(KIND, begin, work),
    ]
}

const KIND: &str = "learn";

/// Learning with everything decided.
#[derive(Serialize, Deserialize)]
struct Plan {
    policy: String,
    world: String,
    /// Valid attempts in the world.
    attempts: usize,
    setup: TrainConfig,
    /// As asked for; kept with the policy.
    config: Value,
}

/// Queues learning on.
fn begin(app: &App, (Id(id), Kept(body, asked)): (Id, Kept<LearnIn>), keep: Keep<JobOut>) -> Result<JobOut> {
    let world = app.worlds().get(&body.world)?;
    let tasks = explored(world.tasks());
    let seed = body.seed.unwrap_or(0);
    let usual = LearnConfig::paper();
    let paper = TrainConfig::preset(world.tasks().learning());
    let whole = |field: &str, value: Option<u64>, default: usize, most: u64| match value {
        None => Ok(default),
        Some(v) if (1..=most).contains(&v) => Ok(v as usize),
        Some(v) => Err(Error::input(field, v, format!("a whole number from 1 to {most}"))),
    };
    let setup = TrainConfig {
        batches: whole("batches", body.batches, usual.batches, 100_000)?,
        batch_size: whole("batch_size", body.batch_size, usual.batch_size, 4096)?,
        learning_rate: body.learning_rate.unwrap_or(usual.learning_rate),
        seed,
        ..paper
    };
    setup.validate()?;
    let first = if id == UNTRAINED { untrained(&tasks, &setup)? } else { load(app, &id)? };
    first.fits(&tasks[0]).map_err(|e| match e {
        Error::Input(input) => Error::input("world", format!("{:?}", body.world), input.allowed),
        other => other,
    })?;
    let attempts =
        whole("attempts", body.attempts, (setup.batches * setup.batch_size).min(100_000), 100_000)?;
    if let Some(left) = world.remaining().filter(|left| *left < attempts as u64) {
        let allowed = format!("at most {left}, what is left of the world's budget");
        return Err(Error::input("attempts", attempts, allowed));
    }
    let config = of_policy(asked, &id);
    let plan = Plan { policy: id, world: body.world, attempts, setup, config: config.clone() };
    let new = New { kind: KIND, config: &config, plan: &json(&plan)?, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// The work of learning on.
fn work(base: &Arc<Base>, plan: &Value) -> Result<Work> {
    let plan: Plan = from_value(plan.clone())?;
    let base = base.clone();
    // Held from now on, so that it does not idle out.
    let world = base.worlds.get(&plan.world, base.now())?;
    Ok(Box::new(move |context| run(&base, context, &plan, &world)))
}

fn run(base: &Base, context: &Context, plan: &Plan, world: &World) -> Result<Outcome> {
    let (store, job) = (&*base.store, context.number);
    let tasks = explored(world.tasks());
    let dqn = match plan.policy.as_str() {
        UNTRAINED => untrained(&tasks, &plan.setup)?,
        id => began_with(store, job, id, store.weights(id)?)?,
    };
    let data = gathered(base, context, plan, world, tasks)?;
    if data.solving() == 0 {
        return Err(Error::Failed(format!(
            "none of {} attempts in {} solved its task, so there is nothing to learn; ask for more attempts",
            data.rows.len(),
            plan.world
        )));
    }
    let (learned, log) = dqn.learn_more(&data, &plan.setup, context)?;
    let weights =
        learned.to_safetensors().ok_or_else(|| Error::Failed("the policy has no weights".into()))?;
    let id = free_id(store, context.id)?;
    let training = if plan.policy == UNTRAINED { "direct" } else { "learned_on" };
    let stored = PolicyRow {
        id: id.clone(),
        training: training.into(),
        config: plan.config.clone(),
        job: Some(context.id.into()),
        owner: context.owner.map(String::from),
        ..row(&id, &learned, weights.len())
    };
    store.put_policy(&stored, &weights, None)?;
    Ok(Outcome::Done(json!({
        "policy": id,
        "from": plan.policy,
        "loss": log.loss,
        "interactions": data.rows.len(),
        "solving": data.solving(),
        "world_kind": world.kind().name(),
        "config": json(&plan.setup)?,
    })))
}

/// Random attempts, task by task.
fn gathered(base: &Base, context: &Context, plan: &Plan, world: &World, tasks: Vec<Task>) -> Result<Dataset> {
    let attempts = Attempts::new(base, context, world, &plan.world)?;
    let drawn = explore::draw(&tasks, plan.attempts, &mut rng::stream(plan.setup.seed, "attempts"))?;
    let mut rows = Vec::with_capacity(drawn.len());
    for (t, task) in tasks.iter().enumerate() {
        context.report("acting in the world", t as u64, tasks.len() as u64)?;
        let actions: Vec<ValidAction> = drawn.iter().filter(|d| d.0 == t).map(|d| d.1.clone()).collect();
        let solved = attempts.solved(t as u64, task, &actions)?;
        let of_task = actions.into_iter().zip(solved);
        rows.extend(of_task.filter_map(|(action, s)| Some(Example { task: t, action, solved: s? })));
    }
    Ok(Dataset { tasks, rows })
}

fn untrained(tasks: &[Task], setup: &TrainConfig) -> Result<Dqn> {
    Dqn::untrained(&tasks[0], setup.hidden, setup.seed)
}
