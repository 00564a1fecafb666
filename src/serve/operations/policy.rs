//! Policies: train, act, evaluate, weights.

use serde_json::{Value, json};

use super::job::json as to_json;
use crate::error::{Error, Result};
use crate::job::Work;
use crate::policy::{
    CHUNK, Dqn, EvaluateConfig, LabelConfig, Policy, TrainConfig, Training, evaluate, label, rank, train,
};
use crate::progress::Progress;
use crate::serve::app::App;
use crate::serve::wire::{
    ActIn, Acted, EvaluateIn, JobOut, Object, Policies, PolicyOut, Scored, SplitIn, TrainIn, TrainingIn,
    effects,
};
use crate::session::Kind;
use crate::store::{PolicyRow, Store};
use crate::task::{Placement, Split, Task, ValidAction, split};
use crate::world::Latents;

/// Queues a training.
pub fn training(app: &App, body: TrainIn, config: Value) -> Result<JobOut> {
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
    let paper = TrainConfig::paper_bowling();
    let setup = TrainConfig {
        batches: whole("batches", body.batches, paper.batches, 100_000)?,
        batch_size: whole("batch_size", body.batch_size, paper.batch_size, 4096)?,
        seed,
        ..paper
    };
    setup.validate()?;
    let training =
        if tasks.tasks.len() > 1 { split(&tasks.tasks, Split::Train) } else { tasks.tasks.to_vec() };
    let labels = LabelConfig { seed, ..LabelConfig::default() };
    let (store, metrics) = (app.store.clone(), app.metrics.clone());
    let kept = config.clone();
    let work: Work = Box::new(move |job, progress: &dyn Progress| {
        let data = label(&training, &schooling, &labels, progress)?;
        metrics.simulated(data.rows.len() as u64);
        let (dqn, log) = train(&data, &setup, progress)?;
        let weights =
            dqn.to_safetensors().ok_or_else(|| Error::Failed("the policy has no weights".into()))?;
        let id = free_id(&store, &job.replace("job", "policy"))?;
        let row = PolicyRow {
            id: id.clone(),
            training: name.into(),
            config: kept,
            job: Some(job.into()),
            ..row(&id, &dqn, weights.len())
        };
        store.put_policy(&row, &weights)?;
        Ok(json!({
            "policy": id,
            "loss": log.loss,
            "examples": data.rows.len(),
            "solving": data.solving(),
            "training": to_json(&schooling)?,
            "labels": to_json(&labels)?,
            "config": to_json(&setup)?,
        }))
    });
    Ok(app.jobs.submit("train", &config, seed, work)?.into())
}

/// All policies.
pub fn list(app: &App) -> Result<Policies> {
    Ok(Policies { policies: app.store.policies()?.into_iter().map(PolicyOut::from).collect() })
}

/// One policy.
pub fn get(app: &App, id: &str) -> Result<PolicyOut> {
    app.store.policy(id)?.map(PolicyOut::from).ok_or_else(|| unknown(id))
}

/// Forgets a policy.
pub fn delete(app: &App, id: &str) -> Result<()> {
    if app.store.remove_policy(id)? { Ok(()) } else { Err(unknown(id)) }
}

/// A policy's weights, safetensors.
pub fn weights(app: &App, id: &str) -> Result<Vec<u8>> {
    app.store.weights(id)?.ok_or_else(|| unknown(id))
}

/// Stores weights under `id`; whether the policy is new.
pub fn put_weights(app: &App, id: &str, bytes: &[u8]) -> Result<(PolicyOut, bool)> {
    let first = id.chars().next().is_some_and(|c| c.is_ascii_alphanumeric());
    if !(first && id.len() <= 64 && id.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c))) {
        let allowed = "1 to 64 letters, digits, `.`, `_` or `-`, the first a letter or digit";
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

/// The actions a policy likes best.
pub fn act(app: &App, id: &str, body: &ActIn) -> Result<Acted> {
    let count = body.count.unwrap_or(1);
    if !(1..=10_000).contains(&count) {
        return Err(Error::input("count", count, "a whole number from 1 to 10000"));
    }
    let dqn = load(app, id)?;
    let task = app.catalogue.task(&body.task)?;
    dqn.fits(&task)?;
    let actions: Vec<ValidAction> =
        (0..task.actions().count()).map(|i| task.actions().at(i)).collect::<Result<_>>()?;
    let order = rank(&dqn, &task, &actions, CHUNK)?;
    let placeable = |i: &usize| matches!(task.place(&actions[*i]), Placement::Valid(_));
    let best: Vec<usize> = order.into_iter().filter(placeable).take(count as usize).collect();
    let chosen: Vec<ValidAction> = best.iter().map(|i| actions[*i].clone()).collect();
    let scores = dqn.score(&task, &chosen)?;
    let scored = best.into_iter().zip(chosen).zip(scores).map(|((index, action), score)| Scored {
        index,
        action: action.values().to_vec(),
        score,
    });
    Ok(Acted { actions: scored.collect() })
}

/// Queues an evaluation.
pub fn evaluation(app: &App, id: &str, body: &EvaluateIn, config: Value) -> Result<JobOut> {
    let dqn = load(app, id)?;
    let world = app.worlds.get(&body.world, app.now())?;
    let part = body.split.unwrap_or(SplitIn::Test);
    let tasks = split(&world.tasks().tasks, part.into());
    if tasks.is_empty() {
        let name = Split::from(part).name();
        return Err(Error::input("split", format!("{name:?}"), "a split of which the world has tasks"));
    }
    dqn.fits(&tasks[0]).map_err(|e| match e {
        Error::Input(input) => Error::input("world", format!("{:?}", body.world), input.allowed),
        other => other,
    })?;
    let most = body.attempts.unwrap_or(100);
    if !(1..=100).contains(&most) {
        return Err(Error::input("attempts", most, "a whole number from 1 to 100"));
    }
    let seed = body.seed.unwrap_or(0);
    let setup = EvaluateConfig::phyre(seed);
    let metrics = app.metrics.clone();
    let work: Work = Box::new(move |_, progress: &dyn Progress| {
        let mut spent = Spent { task: String::new(), here: 0, all: 0 };
        let mut attempt = |task: &Task, actions: &[ValidAction]| {
            if spent.task != task.id {
                (spent.task, spent.here) = (task.id.clone(), 0);
            }
            let left = (most - spent.here) as usize;
            let placeable = actions.iter().map(|a| matches!(task.place(a), Placement::Valid(_)));
            let tried: Vec<bool> = placeable
                .scan(0, |n, valid| {
                    *n += usize::from(valid);
                    Some(valid && *n <= left)
                })
                .collect();
            let chosen: Vec<ValidAction> =
                actions.iter().zip(&tried).filter(|(_, t)| **t).map(|(a, _)| a.clone()).collect();
            let mut results = world.attempts(task, &chosen)?.into_iter();
            spent.here += chosen.len() as u64;
            spent.all += chosen.len() as u64;
            metrics.attempted(world.kind(), chosen.len() as u64);
            let solved = |tried: bool| {
                if tried { results.next().and_then(|r| r.ok()).map(|t| t.solved()) } else { None }
            };
            Ok(tried.into_iter().map(solved).collect())
        };
        let evaluation = evaluate(&dqn, &tasks, &setup, &mut attempt, progress)?;
        let rows = tasks.iter().zip(&evaluation.solved_at);
        Ok(json!({
            "auccess": evaluation.auccess,
            "solved_within": evaluation.curve.to_vec(),
            "tasks": rows.map(|(t, at)| json!({"task": t.id, "solved_at": at})).collect::<Vec<_>>(),
            "interactions": spent.all,
            "world_kind": if world.kind() == Kind::Real { "real" } else { "sim" },
            "config": to_json(&setup)?,
        }))
    });
    Ok(app.jobs.submit("evaluate", &config, seed, work)?.into())
}

/// Valid attempts of an evaluation.
struct Spent {
    task: String,
    /// On this task.
    here: u64,
    /// On all tasks.
    all: u64,
}

/// `wanted`, or that with a number behind it if a client has stored weights under it.
fn free_id(store: &Store, wanted: &str) -> Result<String> {
    let mut id = wanted.to_string();
    let mut n = 1;
    while store.policy(&id)?.is_some() {
        n += 1;
        id = format!("{wanted}.{n}");
    }
    Ok(id)
}

fn load(app: &App, id: &str) -> Result<Dqn> {
    Dqn::from_safetensors(&weights(app, id)?)
}

fn row(id: &str, dqn: &Dqn, bytes: usize) -> PolicyRow {
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

fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "policy", id: id.to_string(), known: Vec::new() }
}
