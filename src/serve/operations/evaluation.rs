//! Evaluation as a job: AUCCESS in a world of a stored policy, of random actions, or of a client's ranking. A restarted job
//! uses the same weights and makes no attempt twice.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::job::submit;
use super::json::to_value;
use super::policy_store::{RANDOM, RANKED, check_world, load, load_for_job, with_policy_id};
use super::rollouts::PersistedRollouts;
use crate::error::{Error, Result, check_count};
use crate::job::{Work, WorkOutcome};
use crate::json::from_value;
use crate::policy::{EvaluateConfig, Policy, RandomPolicy, evaluate, evaluate_orders};
use crate::serve::operation::{ACT, BodyWithJson, Operation, PathId, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::{EvaluateIn, JobOut, RankingIn};
use crate::session::World;
use crate::task::{Placement, Split, Task, ValidAction, split};

/// Operations on evaluations.
pub fn operations() -> Vec<Operation> {
    vec![
        post("evaluate_policy", "/v1/policies/{id}/evaluate", "policies", ACT)
            .about(
                "Evaluates a policy in a world by AUCCESS. A job; its attempts are counted in the world. Built-in \
                 policies: `random`,\nand `ranked` for policies outside the server, whose ranking is part of the request.",
            )
            .errors(&[(404, "Unknown policy or world"), (409, "The policy `untrained`")])
            .job(KIND, begin, work),
    ]
}

const KIND: &str = "evaluate";
/// Maximum number of actions in a ranking, over all tasks.
const MAX_RANKED_ACTIONS: usize = 100_000;

/// Queues an evaluation.
fn begin(
    app: &RequestContext,
    (PathId(id), BodyWithJson(body, asked)): (PathId, BodyWithJson<EvaluateIn>),
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let world = app.worlds().get(&body.world)?.world;
    let part = body.split.unwrap_or(Split::Test);
    match (&body.ranking, id.as_str()) {
        (Some(_), RANKED) if body.split.is_some() => {
            let name = part.name();
            return Err(Error::input("split", format!("{name:?}"), "no split: the ranking names its tasks"));
        }
        (Some(ranking), RANKED) => drop(orders(&world, ranking)?),
        (Some(_), _) => {
            return Err(Error::input(
                "ranking",
                "given",
                format!("no ranking, except for the policy {RANKED}"),
            ));
        }
        (None, RANKED) => {
            return Err(Error::input("ranking", "absent", "tasks with their actions, best first"));
        }
        (None, _) => {
            let tasks = split(&world.tasks().tasks, part);
            let Some(first) = tasks.first() else {
                let name = part.name();
                let allowed = "a split with tasks in this world";
                return Err(Error::input("split", format!("{name:?}"), allowed));
            };
            if id != RANDOM {
                check_world(&load(app, &id)?, first, &body.world)?;
            }
        }
    }
    check_count("attempts", body.attempts, 1, 100)?;
    let attempts = body.attempts.unwrap_or(100);
    let seed = body.seed.unwrap_or(0);
    let config = with_policy_id(asked, &id);
    let plan = EvaluationJob {
        policy: id,
        world: body.world,
        split: part,
        attempts,
        setup: EvaluateConfig::phyre(seed),
        ranking: body.ranking,
    };
    submit(app, KIND, &config, &plan, seed, keep)
}

/// A fully specified evaluation.
#[derive(Serialize, Deserialize)]
struct EvaluationJob {
    policy: String,
    world: String,
    split: Split,
    attempts: u64,
    setup: EvaluateConfig,
    #[serde(default)]
    ranking: Option<Vec<RankingIn>>,
}

/// The work of an evaluation.
fn work(base: &Arc<CoreState>, plan: &Value) -> Result<Work> {
    let plan: EvaluationJob = from_value(plan.clone())?;
    let base = base.clone();
    // The reference keeps the world from expiring; load the weights now, since the policy can be replaced.
    let world = base.worlds.get(&plan.world, base.now())?;
    let now = base.store.weights(&plan.policy)?;
    Ok(Box::new(move |context| {
        let job = context.number;
        let attempts = PersistedRollouts::new(&base, context, &world, &plan.world)?;
        let mut spent = AttemptCounter { calls: 0, task: String::new(), here: 0, all: 0 };
        let mut attempt = |task: &Task, actions: &[ValidAction]| {
            let tried = spent.within(task, actions, plan.attempts);
            let chosen: Vec<ValidAction> =
                actions.iter().zip(&tried).filter(|(_, t)| **t).map(|(a, _)| a.clone()).collect();
            let mut solved = attempts.solved(spent.count(chosen.len()), task, &chosen)?.into_iter();
            Ok(tried.into_iter().map(|tried| if tried { solved.next().flatten() } else { None }).collect())
        };
        let (tasks, evaluation) = match &plan.ranking {
            Some(ranking) => {
                let (tasks, orders) = orders(&world, ranking)?;
                let found = evaluate_orders(&tasks, &orders, plan.setup.batch, &mut attempt, context)?;
                (tasks, found)
            }
            None => {
                let policy: Box<dyn Policy> = match plan.policy.as_str() {
                    RANDOM => Box::new(RandomPolicy { seed: plan.setup.seed }),
                    _ => Box::new(load_for_job(&base.store, job, &plan.policy, now)?),
                };
                let tasks = split(&world.tasks().tasks, plan.split);
                let found = evaluate(policy.as_ref(), &tasks, &plan.setup, &mut attempt, context)?;
                (tasks, found)
            }
        };
        let rows = tasks.iter().zip(&evaluation.solved_at);
        Ok(WorkOutcome::Done(json!({
            "auccess": evaluation.auccess,
            "solved_within": evaluation.curve.to_vec(),
            "tasks": rows.map(|(t, at)| json!({"task": t.id, "solved_at": at})).collect::<Vec<_>>(),
            "interactions": spent.all,
            "world_kind": world.kind().name(),
            "config": to_value(&plan.setup)?,
        })))
    }))
}

/// The tasks and actions of a ranking, validated.
fn orders(world: &World, ranking: &[RankingIn]) -> Result<(Vec<Task>, Vec<Vec<ValidAction>>)> {
    let count: usize = ranking.iter().map(|r| r.actions.len()).sum();
    if ranking.is_empty() || count > MAX_RANKED_ACTIONS {
        let allowed = format!("at least one task, and at most {MAX_RANKED_ACTIONS} actions in all");
        return Err(Error::input("ranking", format!("{} tasks, {count} actions", ranking.len()), allowed));
    }
    let (mut tasks, mut orders): (Vec<Task>, _) = (Vec::new(), Vec::new());
    for (i, row) in ranking.iter().enumerate() {
        let known = world.tasks().tasks.iter().find(|t| t.id == row.task);
        let known = known.filter(|_| tasks.iter().all(|t| t.id != row.task)).ok_or_else(|| {
            let allowed = "a task of the world, each at most once";
            Error::input(format!("ranking[{i}].task"), format!("{:?}", row.task), allowed)
        })?;
        let checked = row.actions.iter().enumerate().map(|(k, action)| {
            let of = format!("ranking[{i}].actions[{k}]");
            known.actions().validate(action).map_err(|e| e.in_field(&of))
        });
        orders.push(checked.collect::<Result<Vec<_>>>()?);
        tasks.push(known.clone());
    }
    Ok((tasks, orders))
}

/// Counts the valid attempts of an evaluation.
struct AttemptCounter {
    /// Batches so far.
    calls: u64,
    task: String,
    /// On this task.
    here: u64,
    /// On all tasks.
    all: u64,
}

impl AttemptCounter {
    /// Which actions to attempt: those that can be placed, up to `most` per task.
    fn within(&mut self, task: &Task, actions: &[ValidAction], most: u64) -> Vec<bool> {
        if self.task != task.id {
            (self.task, self.here) = (task.id.clone(), 0);
        }
        let left = (most - self.here) as usize;
        let placeable = actions.iter().map(|a| matches!(task.place(a), Placement::Valid(_)));
        let counted = placeable.scan(0, |n, valid| {
            *n += usize::from(valid);
            Some(valid && *n <= left)
        });
        counted.collect()
    }

    /// Counts a batch of attempts and returns its number.
    fn count(&mut self, attempts: usize) -> u64 {
        self.here += attempts as u64;
        self.all += attempts as u64;
        self.calls += 1;
        self.calls - 1
    }
}
