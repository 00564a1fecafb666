//! Fine-tuning as a job: trains a policy further on random attempts on a world's training tasks. With the policy [`UNTRAINED`]
//! this is direct learning, the baseline without simulation. A restarted job makes no attempt twice.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::estimation::exploration_tasks;
use super::job::submit;
use super::json::to_value;
use super::policy_store::{UNTRAINED, check_world, load, load_for_job, store_trained, with_policy_id};
use super::rollouts::PersistedRollouts;
use crate::error::{Error, Result, check_count};
use crate::experiment::transfer::LearnConfig;
use crate::explore;
use crate::job::{JobContext, Work, WorkOutcome};
use crate::json::from_value;
use crate::policy::{Dataset, Dqn, Example, TrainConfig};
use crate::progress::Progress;
use crate::rng;
use crate::serve::operation::{ACT, BodyWithJson, Operation, PathId, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::{JobOut, LearnIn};
use crate::session::World;
use crate::task::{Task, ValidAction};

/// Operations on fine-tuning.
pub fn operations() -> Vec<Operation> {
    vec![
        post("learn_policy", "/v1/policies/{id}/learn", "policies", ACT)
            .about(
                "Trains a policy further in a world, on random attempts on its training tasks. A job; its result names the \
                 new\npolicy. With the built-in policy `untrained` this is direct learning, without simulation.",
            )
            .errors(&[(404, "Unknown policy or world"), (409, "The policy `random`, which cannot learn")])
            .job(KIND, begin, work),
    ]
}

const KIND: &str = "learn";

/// A fully specified fine-tuning.
#[derive(Serialize, Deserialize)]
struct LearningJob {
    policy: String,
    world: String,
    /// Valid attempts in the world.
    attempts: usize,
    setup: TrainConfig,
    /// The request, stored with the policy.
    config: Value,
}

/// Queues a fine-tuning.
fn begin(
    app: &RequestContext,
    (PathId(id), BodyWithJson(body, asked)): (PathId, BodyWithJson<LearnIn>),
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let world = app.worlds().get(&body.world)?.world;
    let tasks = exploration_tasks(world.tasks());
    let seed = body.seed.unwrap_or(0);
    let usual = LearnConfig::paper();
    let paper = TrainConfig::preset(world.tasks().learning());
    for (field, value, most) in [
        ("batches", body.batches, 100_000),
        ("batch_size", body.batch_size, 4096),
        ("attempts", body.attempts, 100_000),
    ] {
        check_count(field, value, 1, most)?;
    }
    let setup = TrainConfig {
        batches: body.batches.map_or(usual.batches, |n| n as usize),
        batch_size: body.batch_size.map_or(usual.batch_size, |n| n as usize),
        learning_rate: body.learning_rate.unwrap_or(usual.learning_rate),
        seed,
        ..paper
    };
    setup.validate()?;
    let first = if id == UNTRAINED { untrained(&tasks, &setup)? } else { load(app, &id)? };
    check_world(&first, &tasks[0], &body.world)?;
    let attempts = body.attempts.map_or((setup.batches * setup.batch_size).min(100_000), |n| n as usize);
    if let Some(left) = world.remaining().filter(|left| *left < attempts as u64) {
        let allowed = format!("at most {left}, the world's remaining budget");
        return Err(Error::input("attempts", attempts, allowed));
    }
    let config = with_policy_id(asked, &id);
    let plan = LearningJob { policy: id, world: body.world, attempts, setup, config: config.clone() };
    submit(app, KIND, &config, &plan, seed, keep)
}

/// The work of a fine-tuning.
fn work(base: &Arc<CoreState>, plan: &Value) -> Result<Work> {
    let plan: LearningJob = from_value(plan.clone())?;
    let base = base.clone();
    // The reference keeps the world from expiring.
    let world = base.worlds.get(&plan.world, base.now())?;
    Ok(Box::new(move |context| run(&base, context, &plan, &world)))
}

fn run(base: &CoreState, context: &JobContext, plan: &LearningJob, world: &World) -> Result<WorkOutcome> {
    let (store, job) = (&*base.store, context.number);
    let tasks = exploration_tasks(world.tasks());
    let dqn = match plan.policy.as_str() {
        UNTRAINED => untrained(&tasks, &plan.setup)?,
        id => load_for_job(store, job, id, store.weights(id)?)?,
    };
    let data = collect_attempts(base, context, plan, world, tasks)?;
    if data.solving() == 0 {
        return Err(Error::Failed(format!(
            "none of {} attempts in {} solved its task, so there is nothing to learn; ask for more attempts",
            data.rows.len(),
            plan.world
        )));
    }
    let (learned, log) = dqn.learn_more(&data, &plan.setup, context)?;
    let training = if plan.policy == UNTRAINED { "direct" } else { "learned_on" };
    let id = store_trained(store, context, &learned, training, &plan.config)?;
    Ok(WorkOutcome::Done(json!({
        "policy": id,
        "from": plan.policy,
        "loss": log.loss,
        "interactions": data.rows.len(),
        "solving": data.solving(),
        "world_kind": world.kind().name(),
        "config": to_value(&plan.setup)?,
    })))
}

/// Makes random attempts, task by task.
fn collect_attempts(
    base: &CoreState,
    context: &JobContext,
    plan: &LearningJob,
    world: &World,
    tasks: Vec<Task>,
) -> Result<Dataset> {
    let attempts = PersistedRollouts::new(base, context, world, &plan.world)?;
    let mut stream = rng::stream(plan.setup.seed, "attempts");
    let drawn = explore::draw_placeable(&tasks, plan.attempts, &mut stream, context)?;
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
