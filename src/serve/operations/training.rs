//! Training a policy in simulation, as a job.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::estimation::explored;
use super::stored::{free_id, row};
use super::text::json;
use crate::error::{Error, Result};
use crate::job::{Context, New, Outcome, Work};
use crate::json::from_value;
use crate::policy::{LabelConfig, Policy, TrainConfig, Training, Validation, label, train_validated};
use crate::serve::app::App;
use crate::serve::operation::{ACT, Keep, Kept, Operation, post};
use crate::serve::shared::Base;
use crate::serve::wire::{JobOut, Object, TrainIn, TrainingIn, effects};
use crate::store::PolicyRow;
use crate::task::{Labels, Split, split};
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

/// A training with everything decided.
#[derive(Serialize, Deserialize)]
struct Plan {
    task: String,
    /// `fixed` or `randomised`.
    training: String,
    schooling: Training,
    labels: LabelConfig,
    setup: TrainConfig,
    #[serde(default)]
    validations: usize,
    /// As asked for; kept with the policy.
    config: Value,
}

/// Queues a training.
fn begin(app: &App, Kept(body, config): Kept<TrainIn>, keep: Keep<JobOut>) -> Result<JobOut> {
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
    let validations = whole("validations", body.validations, 0, 100)?;
    let labels = LabelConfig::preset(&usual.labels, seed);
    let training = name.into();
    let asked = config.clone();
    let plan = Plan { task: body.task, training, schooling, labels, setup, validations, config: asked };
    let new = New { kind: KIND, config: &config, plan: &json(&plan)?, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// The work of a training: begun again, it does everything again, and finds the same.
fn work(base: &Arc<Base>, plan: &Value) -> Result<Work> {
    let plan: Plan = from_value(plan.clone())?;
    let base = base.clone();
    Ok(Box::new(move |context| {
        let tasks = explored(&base.catalogue.named(&plan.task)?);
        let data = label(&tasks, &plan.schooling, &plan.labels, context)?;
        base.metrics.simulated(data.rows.len() as u64);
        let validation = validation(&base, &plan, context)?;
        let (dqn, log) = train_validated(&data, validation.as_ref(), &plan.setup, context)?;
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
            "loss": log.loss,
            "validation": json(&log.validation)?,
            "examples": data.rows.len(),
            "solving": data.solving(),
            "training": json(&plan.schooling)?,
            "labels": json(&plan.labels)?,
            "config": json(&plan.setup)?,
        })))
    }))
}

/// The validation that was asked for: the family's validation tasks, labelled in the training's simulation. Tasks that few
/// actions solve are not searched longer; it is a look, and not learned from.
fn validation(base: &Base, plan: &Plan, context: &Context) -> Result<Option<Validation>> {
    if plan.validations == 0 {
        return Ok(None);
    }
    let family = plan.task.split(':').next().unwrap_or_default();
    let tasks = split(&base.catalogue.family(family)?.tasks, Split::Validation);
    let labels = Labels { per_task: plan.labels.per_task, enough_solving: 0, stretch: 1 };
    let data = label(&tasks, &plan.schooling, &LabelConfig::preset(&labels, plan.labels.seed), context)?;
    base.metrics.simulated(data.rows.len() as u64);
    Validation::new(&data, plan.validations).map(Some)
}
