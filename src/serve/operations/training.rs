//! Training a policy in simulation, as a job.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::estimation::explored;
use super::stored::{free_id, row};
use super::text::json;
use crate::error::{Error, Result};
use crate::estimate::Belief;
use crate::job::{Context, New, Outcome, Work};
use crate::json::from_value;
use crate::policy::{
    Dataset, Dqn, EvaluateConfig, Judge, LabelConfig, Policy, Saturation, TrainConfig, TrainLog, Training,
    Validation, label, train_saturated, train_validated,
};
use crate::serve::app::App;
use crate::serve::operation::{ACT, Keep, Kept, Operation, post};
use crate::serve::shared::Base;
use crate::serve::wire::{JobOut, Object, TrainIn, TrainPresetIn, TrainingIn, effects};
use crate::session::TaskSet;
use crate::store::PolicyRow;
use crate::task::{Labels, Split, Task, split};
use crate::world::Latents;

/// Training.
pub fn operations() -> Vec<Operation> {
    vec![
        post("train_policy", "/v1/policies", "policies", ACT)
            .about("Trains a policy in simulation. A job; its result names the policy.")
            .refuses(&[(404, "Unknown task")])
            .queues(KIND, begin, work),
    ]
}

const KIND: &str = "train";
/// Most draws of a belief that a training is kept with.
const MOST_DRAWS: usize = 10_000;

/// A training with everything decided.
#[derive(Serialize, Deserialize)]
struct Plan {
    task: String,
    /// `fixed`, `randomised` or `believed`.
    training: String,
    schooling: Training,
    labels: LabelConfig,
    setup: TrainConfig,
    #[serde(default)]
    validations: usize,
    /// Of a training for as long as it helps.
    #[serde(default)]
    until: Option<Saturation>,
    /// As asked for; kept with the policy.
    config: Value,
}

/// Queues a training.
fn begin(app: &App, Kept(mut body, sent): Kept<TrainIn>, keep: Keep<JobOut>) -> Result<JobOut> {
    let tasks = app.catalogue.named(&body.task)?;
    let schooling = schooling(&mut body, &tasks)?;
    let seed = body.seed.unwrap_or(0);
    let whole = |field: &str, value: Option<u64>, default: usize, most: u64| match value {
        None => Ok(default),
        Some(v) if v <= most => Ok(v as usize),
        Some(v) => Err(Error::input(field, v, format!("a whole number up to {most}"))),
    };
    let saturating = body.preset == Some(TrainPresetIn::Saturating);
    let usual = if saturating { tasks.learning().saturating() } else { *tasks.learning() };
    let paper = TrainConfig::preset(&usual);
    let setup = TrainConfig {
        batches: whole("batches", body.batches, paper.batches, 100_000)?,
        batch_size: whole("batch_size", body.batch_size, paper.batch_size, 4096)?,
        seed,
        ..paper
    };
    setup.validate()?;
    let validations = whole("validations", body.validations, 0, 100)?;
    let until = if saturating { Some(until(&body, &tasks, &setup)?) } else { None };
    let labels = LabelConfig::preset(&usual.labels, seed);
    let training = schooling.name().into();
    let config = without_draws(sent, &schooling);
    let asked = config.clone();
    let plan =
        Plan { task: body.task, training, schooling, labels, setup, validations, until, config: asked };
    let new = New { kind: KIND, config: &config, plan: &json(&plan)?, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// The physics that labels come from, as it was asked for.
fn schooling(body: &mut TrainIn, tasks: &TaskSet) -> Result<Training> {
    if let Some(document) = body.belief.take() {
        let given = [
            ("training", body.training.is_some()),
            ("latents", body.latents.is_some()),
            ("effects", body.effects.is_some()),
        ];
        if let Some((field, _)) = given.iter().find(|(_, given)| *given) {
            return Err(Error::input(*field, "given beside belief", "one or the other"));
        }
        let belief = Belief::from_value(Value::Object(document)).map_err(|e| e.under("belief"))?;
        let draws = belief.draws().len();
        if draws > MOST_DRAWS {
            return Err(Error::input("belief", format!("{draws} draws"), format!("at most {MOST_DRAWS}")));
        }
        return Ok(Training::believed(&belief));
    }
    let given = body.latents.take().map(|Object(l)| l.checked("latents.")).transpose()?;
    let effects = effects(None, body.effects.take(), "")?.unwrap_or_default();
    match body.training.unwrap_or(TrainingIn::Fixed) {
        TrainingIn::Fixed => {
            let prior = tasks.family.map(|f| Latents::of(f.prior.map(|p| p.0))).unwrap_or_default();
            Ok(Training::Fixed { latents: given.unwrap_or_default().or(prior), effects })
        }
        TrainingIn::Randomised if given.is_some() => {
            let allowed = "absent: randomised training draws them";
            Err(Error::input("latents", "given beside `training`: \"randomised\"", allowed))
        }
        TrainingIn::Randomised => Ok(Training::paper_randomised(effects)),
    }
}

/// When a training ends that goes on for as long as it helps.
fn until(body: &TrainIn, tasks: &TaskSet, setup: &TrainConfig) -> Result<Saturation> {
    for (field, given) in [("batches", body.batches.is_some()), ("validations", body.validations.is_some())] {
        if given {
            return Err(Error::input(field, "given beside `preset`: \"saturating\"", "one or the other"));
        }
    }
    if tasks.tasks.len() == 1 || tasks.tasks.iter().all(|t| t.split != Split::Validation) {
        let allowed = "a family with validation tasks, which say when a saturating training ends";
        return Err(Error::input("task", format!("{:?}", body.task), allowed));
    }
    Ok(Saturation::usual(setup))
}

/// What was asked for, with the number of draws in the place of a belief.
fn without_draws(mut sent: Value, schooling: &Training) -> Value {
    if let (Training::Believed { .. }, Some(belief)) = (schooling, sent.get_mut("belief")) {
        *belief = about(schooling);
    }
    sent
}

/// The physics that labels came from, for those who read a result: of draws, how many.
fn about(schooling: &Training) -> Value {
    match schooling {
        Training::Believed { draws } => json!({"type": schooling.name(), "draws": draws.len()}),
        other => json!(other),
    }
}

/// The work of a training: begun again, it does everything again, and finds the same.
fn work(base: &Arc<Base>, plan: &Value) -> Result<Work> {
    let plan: Plan = from_value(plan.clone())?;
    let base = base.clone();
    Ok(Box::new(move |context| {
        let tasks = explored(&base.catalogue.named(&plan.task)?);
        let data = label(&tasks, &plan.schooling, &plan.labels, context)?;
        base.metrics.simulated(data.rows.len() as u64);
        let (dqn, log) = trained(&base, &plan, &data, context)?;
        let weights =
            dqn.to_safetensors().ok_or_else(|| Error::Failed("the policy has no weights".into()))?;
        let id = free_id(&base.store, context.id)?;
        let row = PolicyRow {
            id: id.clone(),
            training: plan.training,
            config: plan.config,
            job: Some(context.id.into()),
            owner: context.owner.map(String::from),
            ..row(&id, &dqn, weights.len())
        };
        base.store.put_policy(&row, &weights, None)?;
        Ok(Outcome::Done(json!({
            "policy": id,
            "batches": dqn.card().batches(),
            "loss": log.loss,
            "validation": json(&log.validation)?,
            "examples": data.rows.len(),
            "solving": data.solving(),
            "training": about(&plan.schooling),
            "labels": json(&plan.labels)?,
            "config": json(&plan.setup)?,
        })))
    }))
}

/// Trains for as long as was asked for.
fn trained(base: &Base, plan: &Plan, data: &Dataset, context: &Context) -> Result<(Dqn, TrainLog)> {
    let Some(until) = &plan.until else {
        let validation = validation(base, plan, context)?;
        return train_validated(data, validation.as_ref(), &plan.setup, context);
    };
    let worlds = plan.schooling.worlds(until.worlds, plan.setup.seed);
    let evaluate = EvaluateConfig::phyre(plan.setup.seed);
    let judge = Judge::new(&held_out(base, plan)?, worlds, &evaluate, plan.labels.engine)?;
    train_saturated(data, &judge, &plan.setup, until, context)
}

/// The family's validation tasks.
fn held_out(base: &Base, plan: &Plan) -> Result<Vec<Task>> {
    let family = plan.task.split(':').next().unwrap_or_default();
    Ok(split(&base.catalogue.family(family)?.tasks, Split::Validation))
}

/// The validation that was asked for: the family's validation tasks, labelled in the training's simulation. Tasks that few
/// actions solve are not searched longer; it is a look, and not learned from.
fn validation(base: &Base, plan: &Plan, context: &Context) -> Result<Option<Validation>> {
    if plan.validations == 0 {
        return Ok(None);
    }
    let tasks = held_out(base, plan)?;
    let labels = Labels { per_task: plan.labels.per_task, enough_solving: 0, stretch: 1 };
    let data = label(&tasks, &plan.schooling, &LabelConfig::preset(&labels, plan.labels.seed), context)?;
    base.metrics.simulated(data.rows.len() as u64);
    Validation::new(&data, plan.validations).map(Some)
}
