//! Planning as a job: ranks a task's actions by rollouts in sampled worlds.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::job::{restartable, submit};
use super::json::to_value;
use crate::commands::{ParameterSource, PlanRequest, TimeLimit};
use crate::error::{Error, Result};
use crate::job::Work;
use crate::plan::{PlanConfig, document, plan};
use crate::serve::operation::{ACT, JsonBody, Operation, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::JobOut;

/// Operations on plans.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_plan", "/v1/plans", "workflow", ACT)
            .about(
                "Ranks a task's actions by their probability of success under a distribution of worlds. A job; its result is \
                 an\n`iplw.plan/1` document: actions best first, with probabilities estimated in new draws.",
            )
            .errors(&[(404, "Unknown task")])
            .job(KIND, begin, work),
    ]
}

const KIND: &str = "plan";

/// A fully specified plan.
#[derive(Serialize, Deserialize)]
struct PlanJob {
    task: String,
    parameter_source: ParameterSource,
    setup: PlanConfig,
    /// Time limit of the search, s.
    seconds: Option<f64>,
}

/// Queues a plan.
fn begin(
    app: &RequestContext,
    JsonBody(body): JsonBody<PlanRequest>,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let task = app.catalogue.named(&body.task)?;
    if !body.task.contains(':') {
        let allowed = format!("one of its tasks, such as `{}`", task.tasks[0].id);
        return Err(Error::input("task", format!("{:?}", body.task), allowed));
    }
    body.check_limits()?;
    let setup = body.config()?;
    let (name, seconds) = (body.task.clone(), body.seconds);
    let parameter_source = body.parameter_source()?;
    let samples = parameter_source.samples(&name, &setup)?;
    // The request without the draws, which are large.
    let about = json!({"source": samples.source(), "draws": samples.draws().len()});
    let config = json!({"task": name, "posterior": about, "seconds": seconds, "config": to_value(&setup)?});
    let (seed, job) = (setup.seed, PlanJob { task: name, parameter_source, setup, seconds });
    submit(app, KIND, &config, &job, seed, keep)
}

/// The work of a plan. After a restart it starts over and gives the same result, unless it has a time limit.
fn work(base: &Arc<CoreState>, job: &Value) -> Result<Work> {
    restartable(base, job, |base, context, job: &PlanJob| {
        let task = base.catalogue.task(&job.task)?;
        let samples = job.parameter_source.samples(&job.task, &job.setup)?;
        let found = plan(&task, &samples, &job.setup, &TimeLimit::new(job.seconds, context), context)?;
        base.metrics.count_rollouts(found.rollouts as u64);
        to_value(&document(&task, &found, &job.setup, &samples))
    })
}
