//! AUCCESS in a world: of a stored policy, of chance, or of an order of actions that a policy outside the server gave.
//! Begun again, the job ranks again with the weights it began with, and makes no attempt twice.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::attempts::Attempts;
use super::stored::{RANDOM, RANKED, began_with, load, of_policy};
use super::text::json;
use crate::error::{Error, Result};
use crate::job::{New, Outcome, Work};
use crate::json::from_value;
use crate::policy::{EvaluateConfig, Policy, Random, evaluate, evaluate_orders};
use crate::serve::app::App;
use crate::serve::operation::{ACT, Id, Keep, Kept, Operation, post};
use crate::serve::shared::Base;
use crate::serve::wire::{EvaluateIn, JobOut, RankingIn, SplitIn};
use crate::session::World;
use crate::task::{Placement, Split, Task, ValidAction, split};

/// Evaluation.
pub fn operations() -> Vec<Operation> {
    vec![
        post("evaluate_policy", "/v1/policies/{id}/evaluate", "policies", ACT)
            .about(
                "Tries a policy's ranking in a world: AUCCESS. A job; its attempts are counted in the world. The \
                 policy `random`\nis always there, and so is `ranked`, for policies outside the server: their \
                 ranking comes with the request.",
            )
            .refuses(&[(404, "Unknown policy or world"), (409, "`untrained`, which knows nothing yet")])
            .queues(KIND, begin, work),
    ]
}

const KIND: &str = "evaluate";
/// Most actions of a ranking, over all of its tasks.
const MOST_RANKED: usize = 100_000;

/// Queues an evaluation.
fn begin(
    app: &App,
    (Id(id), Kept(body, asked)): (Id, Kept<EvaluateIn>),
    keep: Keep<JobOut>,
) -> Result<JobOut> {
    let world = app.worlds().get(&body.world)?;
    let part = body.split.unwrap_or(SplitIn::Test);
    match (&body.ranking, id.as_str()) {
        (Some(_), RANKED) if body.split.is_some() => {
            let name = Split::from(part).name();
            return Err(Error::input("split", format!("{name:?}"), "absent: the ranking names its tasks"));
        }
        (Some(ranking), RANKED) => drop(orders(&world, ranking)?),
        (Some(_), _) => {
            return Err(Error::input("ranking", "given", format!("absent: it is for the policy {RANKED}")));
        }
        (None, RANKED) => {
            return Err(Error::input("ranking", "absent", "tasks with their actions, best first"));
        }
        (None, _) => {
            let tasks = split(&world.tasks().tasks, part.into());
            let Some(first) = tasks.first() else {
                let name = Split::from(part).name();
                let allowed = "a split of which the world has tasks";
                return Err(Error::input("split", format!("{name:?}"), allowed));
            };
            if id != RANDOM {
                load(app, &id)?.fits(first).map_err(|e| match e {
                    Error::Input(input) => Error::input("world", format!("{:?}", body.world), input.allowed),
                    other => other,
                })?;
            }
        }
    }
    let attempts = body.attempts.unwrap_or(100);
    if !(1..=100).contains(&attempts) {
        return Err(Error::input("attempts", attempts, "a whole number from 1 to 100"));
    }
    let seed = body.seed.unwrap_or(0);
    let config = of_policy(asked, &id);
    let plan = Plan {
        policy: id,
        world: body.world,
        split: part.into(),
        attempts,
        setup: EvaluateConfig::phyre(seed),
        ranking: body.ranking,
    };
    let new = New { kind: KIND, config: &config, plan: &json(&plan)?, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// An evaluation with everything decided.
#[derive(Serialize, Deserialize)]
struct Plan {
    policy: String,
    world: String,
    split: Split,
    attempts: u64,
    setup: EvaluateConfig,
    #[serde(default)]
    ranking: Option<Vec<RankingIn>>,
}

/// The work of an evaluation.
fn work(base: &Arc<Base>, plan: &Value) -> Result<Work> {
    let plan: Plan = from_value(plan.clone())?;
    let base = base.clone();
    // Held from now on: the world does not idle out, and the policy may be replaced.
    let world = base.worlds.get(&plan.world, base.now())?;
    let now = base.store.weights(&plan.policy)?;
    Ok(Box::new(move |context| {
        let job = context.number;
        let attempts = Attempts::new(&base, context, &world, &plan.world)?;
        let mut spent = Spent { calls: 0, task: String::new(), here: 0, all: 0 };
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
                    RANDOM => Box::new(Random { seed: plan.setup.seed }),
                    _ => Box::new(began_with(&base.store, job, &plan.policy, now)?),
                };
                let tasks = split(&world.tasks().tasks, plan.split);
                let found = evaluate(policy.as_ref(), &tasks, &plan.setup, &mut attempt, context)?;
                (tasks, found)
            }
        };
        let rows = tasks.iter().zip(&evaluation.solved_at);
        Ok(Outcome::Done(json!({
            "auccess": evaluation.auccess,
            "solved_within": evaluation.curve.to_vec(),
            "tasks": rows.map(|(t, at)| json!({"task": t.id, "solved_at": at})).collect::<Vec<_>>(),
            "interactions": spent.all,
            "world_kind": world.kind().name(),
            "config": json(&plan.setup)?,
        })))
    }))
}

/// The tasks of a ranking and their actions, best first.
fn orders(world: &World, ranking: &[RankingIn]) -> Result<(Vec<Task>, Vec<Vec<ValidAction>>)> {
    let count: usize = ranking.iter().map(|r| r.actions.len()).sum();
    if ranking.is_empty() || count > MOST_RANKED {
        let allowed = format!("at least one task, and at most {MOST_RANKED} actions in all");
        return Err(Error::input("ranking", format!("{} tasks, {count} actions", ranking.len()), allowed));
    }
    let (mut tasks, mut orders): (Vec<Task>, _) = (Vec::new(), Vec::new());
    for (i, row) in ranking.iter().enumerate() {
        let known = world.tasks().tasks.iter().find(|t| t.id == row.task);
        let known = known.filter(|_| tasks.iter().all(|t| t.id != row.task)).ok_or_else(|| {
            let allowed = "tasks of the world, each once";
            Error::input(format!("ranking[{i}].task"), format!("{:?}", row.task), allowed)
        })?;
        let checked = row.actions.iter().enumerate().map(|(k, action)| {
            let of = format!("ranking[{i}].actions[{k}]");
            known.actions().validate(action).map_err(|e| e.under(&of))
        });
        orders.push(checked.collect::<Result<Vec<_>>>()?);
        tasks.push(known.clone());
    }
    Ok((tasks, orders))
}

/// Valid attempts of an evaluation.
struct Spent {
    /// Batches so far.
    calls: u64,
    task: String,
    /// On this task.
    here: u64,
    /// On all tasks.
    all: u64,
}

impl Spent {
    /// Which actions can be placed and are among the task's first `most` of those.
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

    /// Takes down a batch of attempts; its number.
    fn count(&mut self, attempts: usize) -> u64 {
        self.here += attempts as u64;
        self.all += attempts as u64;
        self.calls += 1;
        self.calls - 1
    }
}
