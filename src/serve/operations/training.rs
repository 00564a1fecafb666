//! Training of a policy in simulation, as a job.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::estimation::exploration_tasks;
use super::job::{restartable, submit};
use super::json::to_value;
use super::policy_store::store_trained;
use crate::commands::{TrainingPreset, TrainingRequest};
use crate::error::{Error, Result};
use crate::job::{JobContext, Work};
use crate::policy::{
    Dataset, Dqn, EarlyStopping, LabelConfig, SimulatedValidator, TrainConfig, TrainLog, TrainingPhysics,
    Validation, label, train_validated, train_with_early_stopping,
};
use crate::serve::operation::{ACT, BodyWithJson, Operation, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::JobOut;
use crate::session::TaskSet;
use crate::task::{LabelCounts, Split, Task, split};
use crate::world::Latents;

/// Operations on training.
pub fn operations() -> Vec<Operation> {
    vec![
        post("train_policy", "/v1/policies", "policies", ACT)
            .about("Trains a policy in simulation. A job; its result names the policy.")
            .errors(&[(404, "Unknown task")])
            .job(KIND, begin, work),
    ]
}

const KIND: &str = "train";

/// A fully specified training.
#[derive(Serialize, Deserialize)]
struct TrainingJob {
    task: String,
    /// `fixed`, `randomised` or `believed`.
    training: String,
    #[serde(rename = "schooling")]
    physics: TrainingPhysics,
    labels: LabelConfig,
    setup: TrainConfig,
    #[serde(default)]
    validations: usize,
    /// Early-stopping settings of the preset `saturating`.
    #[serde(default)]
    #[serde(rename = "until")]
    early_stopping: Option<EarlyStopping>,
    /// The request, stored with the policy.
    config: Value,
}

/// Queues a training.
fn begin(
    app: &RequestContext,
    BodyWithJson(mut body, sent): BodyWithJson<TrainingRequest>,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let tasks = app.catalogue.named(&body.task)?;
    let prior = tasks.family.map(|f| Latents::of(f.prior_means())).unwrap_or_default();
    let physics = body.physics(prior)?;
    body.check_limits()?;
    let saturating = body.preset == Some(TrainingPreset::Saturating);
    let usual = if saturating { tasks.learning().saturating() } else { *tasks.learning() };
    let setup = body.config(&usual)?;
    let (seed, validations) = (setup.seed, body.validations.unwrap_or(0) as usize);
    let early_stopping = if saturating { Some(early_stopping(&body, &tasks, &setup)?) } else { None };
    let labels = LabelConfig::preset(&usual.labels, seed);
    let training = physics.name().into();
    let config = without_draws(sent, &physics);
    let asked = config.clone();
    let plan = TrainingJob {
        task: body.task,
        training,
        physics,
        labels,
        setup,
        validations,
        early_stopping,
        config: asked,
    };
    submit(app, KIND, &config, &plan, seed, keep)
}

/// Early-stopping settings of the preset `saturating`.
fn early_stopping(body: &TrainingRequest, tasks: &TaskSet, setup: &TrainConfig) -> Result<EarlyStopping> {
    for (field, given) in [("batches", body.batches.is_some()), ("validations", body.validations.is_some())] {
        if given {
            return Err(Error::input(
                field,
                "given together with `preset`: \"saturating\"",
                "one or the other",
            ));
        }
    }
    if tasks.tasks.len() == 1 || tasks.tasks.iter().all(|t| t.split != Split::Validation) {
        let allowed = "a family with validation tasks, which early stopping needs";
        return Err(Error::input("task", format!("{:?}", body.task), allowed));
    }
    Ok(EarlyStopping::standard(setup))
}

/// The request with a posterior's draws replaced by their number.
fn without_draws(mut sent: Value, physics: &TrainingPhysics) -> Value {
    if let (TrainingPhysics::Posterior { .. }, Some(posterior)) = (physics, sent.get_mut("posterior")) {
        *posterior = about(physics);
    }
    sent
}

/// The labelling physics for a result, with draws replaced by their number.
fn about(physics: &TrainingPhysics) -> Value {
    match physics {
        TrainingPhysics::Posterior { draws } => json!({"type": physics.name(), "draws": draws.len()}),
        other => json!(other),
    }
}

/// The work of a training. After a restart it starts over and gives the same result.
fn work(base: &Arc<CoreState>, plan: &Value) -> Result<Work> {
    restartable(base, plan, |base, context, plan: &TrainingJob| {
        let tasks = exploration_tasks(&base.catalogue.named(&plan.task)?);
        let data = label(&tasks, &plan.physics, &plan.labels, context)?;
        base.metrics.count_rollouts(data.rows.len() as u64);
        let (dqn, log) = train(base, plan, &data, context)?;
        let id = store_trained(&base.store, context, &dqn, &plan.training, &plan.config)?;
        Ok(json!({
            "policy": id,
            "batches": dqn.card().batches(),
            "loss": log.loss,
            "validation": to_value(&log.validation)?,
            "examples": data.rows.len(),
            "solving": data.solving(),
            "training": about(&plan.physics),
            "labels": to_value(&plan.labels)?,
            "config": to_value(&plan.setup)?,
        }))
    })
}

/// Trains with fixed length or early stopping.
fn train(
    base: &CoreState,
    plan: &TrainingJob,
    data: &Dataset,
    context: &JobContext,
) -> Result<(Dqn, TrainLog)> {
    let Some(early_stopping) = &plan.early_stopping else {
        let validation = validation(base, plan, context)?;
        return train_validated(data, validation.as_ref(), &plan.setup, context);
    };
    let tasks = validation_tasks(base, plan)?;
    let judge =
        SimulatedValidator::of_training(&plan.physics, &tasks, early_stopping.worlds, plan.setup.seed)?;
    train_with_early_stopping(data, &judge, &plan.setup, early_stopping, context)
}

/// The family's validation tasks.
fn validation_tasks(base: &CoreState, plan: &TrainingJob) -> Result<Vec<Task>> {
    let family = plan.task.split(':').next().unwrap_or_default();
    Ok(split(&base.catalogue.family(family)?.tasks, Split::Validation))
}

/// The requested validation: the family's validation tasks, labelled in the training simulation. Hard tasks get no additional
/// labels, since the data are not used for learning.
fn validation(base: &CoreState, plan: &TrainingJob, context: &JobContext) -> Result<Option<Validation>> {
    if plan.validations == 0 {
        return Ok(None);
    }
    let tasks = validation_tasks(base, plan)?;
    let labels = LabelCounts { per_task: plan.labels.per_task, enough_solving: 0, stretch: 1 };
    let data = label(&tasks, &plan.physics, &LabelConfig::preset(&labels, plan.labels.seed), context)?;
    base.metrics.count_rollouts(data.rows.len() as u64);
    Validation::new(&data, plan.validations).map(Some)
}
