//! Policies: train, act, evaluate, weights.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::estimation::explored;
use super::evaluation::RANKED;
use super::learning::UNTRAINED;
use super::{Keep, Page, json};
use crate::error::{Error, Result};
use crate::job::{New, Outcome, Work};
use crate::json::from_value;
use crate::policy::{CHUNK, Dqn, LabelConfig, Policy, Random, TrainConfig, Training, label, rank, train};
use crate::serve::app::{App, Base};
use crate::serve::wire::{
    ActIn, Acted, JobOut, Object, Policies, PolicyOut, Scored, TrainIn, TrainingIn, effects,
};
use crate::store::{PolicyRow, Store};
use crate::task::{Placement, ValidAction};
use crate::world::Latents;

/// The kind of job.
pub const TRAIN: &str = "train";
/// The policy that tries actions in random order; always there.
pub const RANDOM: &str = "random";
/// Policies that are always there, and what they are.
const ALWAYS: [(&str, &str); 3] = [
    (RANDOM, "tries actions in random order; may act and be evaluated"),
    (RANKED, "lives with the client, whose order of actions may be evaluated"),
    (UNTRAINED, "knows nothing; learning on from it is direct learning"),
];

/// Queues a training.
pub fn training(app: &App, body: TrainIn, config: &Value, keep: Keep<JobOut>) -> Result<JobOut> {
    let tasks = app.catalogue.named(&body.task)?;
    let given = body.latents.map(|Object(l)| l.checked("latents.")).transpose()?;
    let terms = effects(None, body.effects, "")?.unwrap_or_default();
    let (name, schooling) = match body.training.unwrap_or(TrainingIn::Fixed) {
        TrainingIn::Fixed => {
            let prior = tasks.family.map(|f| Latents::of(f.prior.map(|p| p.0))).unwrap_or_default();
            let latents = given.unwrap_or_default().or(prior);
            ("fixed", Training::Fixed { latents, effects: terms })
        }
        TrainingIn::Randomised if given.is_some() => {
            let allowed = "absent: randomised training draws them";
            return Err(Error::input("latents", "given beside `training`: \"randomised\"", allowed));
        }
        TrainingIn::Randomised => {
            let drawn = match Training::paper_randomised() {
                Training::Randomised { density, friction, restitution, .. } => {
                    Training::Randomised { density, friction, restitution, effects: terms }
                }
                fixed => fixed,
            };
            ("randomised", drawn)
        }
    };
    let seed = body.seed.unwrap_or(0);
    let whole = |field: &str, value: Option<u64>, default: usize, most: u64| match value {
        None => Ok(default),
        Some(v) if v <= most => Ok(v as usize),
        Some(v) => Err(Error::input(field, v, format!("a whole number up to {most}"))),
    };
    let usual = tasks.learning();
    let paper = TrainConfig::preset(usual);
    let setup = TrainConfig {
        batches: whole("batches", body.batches, paper.batches, 100_000)?,
        batch_size: whole("batch_size", body.batch_size, paper.batch_size, 4096)?,
        seed,
        ..paper
    };
    setup.validate()?;
    let labels = LabelConfig::preset(&usual.labels, seed);
    let training = name.into();
    let plan = TrainPlan { task: body.task, training, schooling, labels, setup, config: config.clone() };
    let new = New { kind: TRAIN, config, plan: &json(&plan)?, seed };
    Ok(app.jobs.submit(new, &|job| keep(&job.into()))?.into())
}

/// The work of a training: begun again, it does everything again, and finds the same.
pub fn training_work(base: &Arc<Base>, plan: &Value) -> Result<Work> {
    let plan: TrainPlan = from_value(plan.clone())?;
    let base = base.clone();
    Ok(Box::new(move |context| {
        let tasks = explored(&base.catalogue.named(&plan.task)?);
        let data = label(&tasks, &plan.schooling, &plan.labels, context)?;
        base.metrics.simulated(data.rows.len() as u64);
        let (dqn, log) = train(&data, &plan.setup, context)?;
        let weights =
            dqn.to_safetensors().ok_or_else(|| Error::Failed("the policy has no weights".into()))?;
        let id = free_id(&base.store, context.id)?;
        let row = PolicyRow {
            id: id.clone(),
            training: plan.training,
            config: plan.config,
            job: Some(context.id.into()),
            ..row(&id, &dqn, weights.len())
        };
        base.store.put_policy(&row, &weights)?;
        Ok(Outcome::Done(json!({
            "policy": id,
            "loss": log.loss,
            "examples": data.rows.len(),
            "solving": data.solving(),
            "training": json(&plan.schooling)?,
            "labels": json(&plan.labels)?,
            "config": json(&plan.setup)?,
        })))
    }))
}

/// A page of all policies.
pub fn list(app: &App, page: &Page) -> Result<Policies> {
    let after: i64 = page.after("policies")?.unwrap_or(0);
    let mut all = app.store.policies(after, page.fetch())?;
    let next = page.cut("policies", &mut all, |p| p.0);
    Ok(Policies { policies: all.into_iter().map(|p| PolicyOut::from(p.1)).collect(), next })
}

/// One policy.
pub fn get(app: &App, id: &str) -> Result<PolicyOut> {
    if let Some((id, about)) = ALWAYS.iter().find(|p| p.0 == id) {
        return Ok(PolicyOut {
            id: id.to_string(),
            task: "any".into(),
            training: "none".into(),
            about: about.to_string(),
            config: json!({}),
            job: None,
            version: env!("CARGO_PKG_VERSION").into(),
            bytes: 0,
        });
    }
    app.store.policy(id)?.map(PolicyOut::from).ok_or_else(|| unknown(id))
}

/// Forgets a policy.
pub fn delete(app: &App, id: &str) -> Result<()> {
    if is_always(id) {
        return Err(Error::Refused {
            reason: format!("the policy {id} is always there and cannot be deleted"),
        });
    }
    if app.store.remove_policy(id)? { Ok(()) } else { Err(unknown(id)) }
}

/// A policy's weights, safetensors.
pub fn weights(app: &App, id: &str) -> Result<Vec<u8>> {
    app.store.weights(id)?.ok_or_else(|| without_weights(id))
}

/// Stores weights under `id`; whether the policy is new.
pub fn put_weights(app: &App, id: &str, bytes: &[u8]) -> Result<(PolicyOut, bool)> {
    let first = id.chars().next().is_some_and(|c| c.is_ascii_alphanumeric());
    if !(first && id.len() <= 64 && id.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c))) {
        let allowed = "1 to 64 letters, digits, `.`, `_` or `-`, the first a letter or digit";
        return Err(Error::input("id", format!("{id:?}"), allowed));
    }
    if is_always(id) {
        let allowed = "another name: this policy is always there and has no weights to replace";
        return Err(Error::input("id", format!("{id:?}"), allowed));
    }
    let dqn = Dqn::from_safetensors(bytes).map_err(|e| match e {
        e @ Error::Input(_) => e,
        other => Error::input("body", other, "the safetensors weights of a policy"),
    })?;
    if let Ok(tasks) = app.catalogue.family(&dqn.card().family) {
        dqn.fits(&tasks.tasks[0])?;
    }
    let row = row(id, &dqn, bytes.len());
    let new = app.store.put_policy(&row, bytes)?;
    Ok((row.into(), new))
}

/// The actions a policy likes best; `random` likes an order that is the same every time.
pub fn act(app: &App, id: &str, body: &ActIn) -> Result<Acted> {
    let count = body.count.unwrap_or(1);
    if !(1..=10_000).contains(&count) {
        return Err(Error::input("count", count, "a whole number from 1 to 10000"));
    }
    let task = app.catalogue.task(&body.task)?;
    let policy: Box<dyn Policy> = if id == RANDOM {
        Box::new(Random { seed: 0 })
    } else {
        let dqn = load(app, id)?;
        dqn.fits(&task)?;
        Box::new(dqn)
    };
    let actions: Vec<ValidAction> =
        (0..task.actions().count()).map(|i| task.actions().at(i)).collect::<Result<_>>()?;
    let order = rank(policy.as_ref(), &task, &actions, CHUNK)?;
    let placeable = |i: &usize| matches!(task.place(&actions[*i]), Placement::Valid(_));
    let best: Vec<usize> = order.into_iter().filter(placeable).take(count as usize).collect();
    let chosen: Vec<ValidAction> = best.iter().map(|i| actions[*i].clone()).collect();
    let scores = policy.score(&task, &chosen)?;
    let scored = best.into_iter().zip(chosen).zip(scores).map(|((index, action), score)| Scored {
        index,
        action: action.values().to_vec(),
        score,
    });
    Ok(Acted { actions: scored.collect() })
}

/// The policy as it was when the job began, also if it is replaced meanwhile; `now` are the weights of `id` as they are.
pub fn began_with(store: &Store, job: i64, id: &str, now: Option<Vec<u8>>) -> Result<Dqn> {
    let weights = match (store.artifact(job, WEIGHTS)?, now) {
        (Some(kept), _) => kept,
        (None, Some(now)) => {
            store.put_artifact(job, WEIGHTS, &now)?;
            now
        }
        (None, None) => return Err(unknown(id)),
    };
    Dqn::from_safetensors(&weights)
}

/// The artifact that holds the weights a job began with.
const WEIGHTS: &str = "weights";

/// A training with everything decided.
#[derive(Serialize, Deserialize)]
struct TrainPlan {
    task: String,
    /// `fixed` or `randomised`.
    training: String,
    schooling: Training,
    labels: LabelConfig,
    setup: TrainConfig,
    /// As asked for; kept with the policy.
    config: Value,
}

/// `policy-3` for `job-3`, or that with a number behind it if a client has stored weights under it. What an
/// interrupted run of the same job stored is its own.
pub fn free_id(store: &Store, job: &str) -> Result<String> {
    let wanted = job.replace("job", "policy");
    let mut id = wanted.clone();
    let mut n = 1;
    while store.policy(&id)?.is_some_and(|p| p.job.as_deref() != Some(job)) {
        n += 1;
        id = format!("{wanted}.{n}");
    }
    Ok(id)
}

/// A stored policy.
pub fn load(base: &Base, id: &str) -> Result<Dqn> {
    Dqn::from_safetensors(&base.store.weights(id)?.ok_or_else(|| without_weights(id))?)
}

/// A policy's row; it says that the weights were uploaded.
pub fn row(id: &str, dqn: &Dqn, bytes: usize) -> PolicyRow {
    PolicyRow {
        id: id.into(),
        task: dqn.card().family.clone(),
        training: "uploaded".into(),
        about: dqn.describe(),
        config: serde_json::to_value(dqn.card()).unwrap_or_default(),
        job: None,
        version: env!("CARGO_PKG_VERSION").into(),
        bytes: bytes as u64,
    }
}

fn is_always(id: &str) -> bool {
    ALWAYS.iter().any(|p| p.0 == id)
}

/// There are no weights under this id: there is no such policy, or it never has any.
fn without_weights(id: &str) -> Error {
    if !is_always(id) {
        return unknown(id);
    }
    let reason = format!(
        "the policy {id} is always there and has no weights; train a policy, or let untrained learn in a world, \
         and use the one that comes of it"
    );
    Error::Refused { reason }
}

/// No policy has this id.
pub fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "policy", id: id.to_string(), known: Vec::new() }
}
