//! Planning as a job: ranks a task's actions by rollouts in sampled worlds.

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::json::to_value;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::estimate::ParameterSamples;
use crate::estimate::parameter_samples::PRIOR_SAMPLE_COUNT;
use crate::job::{JobContext, JobSpec, Work, WorkOutcome};
use crate::json::from_value;
use crate::plan::{PlanConfig, document, plan};
use crate::serve::deadline::RequestDeadline;
use crate::serve::operation::{ACT, JsonBody, Operation, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::{JobOut, ParameterSource, PlanIn};
use crate::task::family;

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
    JsonBody(body): JsonBody<PlanIn>,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let task = app.catalogue.named(&body.task)?;
    if !body.task.contains(':') {
        let allowed = format!("one of its tasks, such as `{}`", task.tasks[0].id);
        return Err(Error::input("task", format!("{:?}", body.task), allowed));
    }
    let (name, seconds, setup) = (body.task.clone(), body.seconds, body.config()?);
    let parameter_source = body.parameter_source()?;
    let samples = parameter_samples(&name, &parameter_source, &setup)?;
    // The request without the draws, which are large.
    let about = json!({"source": samples.source(), "draws": samples.draws().len()});
    let config = json!({"task": name, "posterior": about, "seconds": seconds, "config": to_value(&setup)?});
    let (seed, job) = (setup.seed, PlanJob { task: name, parameter_source, setup, seconds });
    let new = JobSpec { kind: KIND, config: &config, plan: &to_value(&job)?, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// The draws of the distribution of worlds.
fn parameter_samples(
    task: &str,
    parameter_source: &ParameterSource,
    setup: &PlanConfig,
) -> Result<ParameterSamples> {
    match parameter_source {
        ParameterSource::Prior { effects } => {
            let prior = family(task.split(':').next().unwrap_or_default())?.prior;
            ParameterSamples::prior(
                prior,
                effects.clone(),
                PRIOR_SAMPLE_COUNT.max(2 * setup.draws),
                setup.seed,
            )
        }
        ParameterSource::Point { latents, effects } => ParameterSamples::point(*latents, effects.clone()),
        ParameterSource::Posterior { document } => {
            ParameterSamples::from_value(document.clone()).map_err(|e| e.in_field("posterior"))
        }
    }
}

/// The work of a plan. After a restart it starts over and gives the same result, unless it has a time limit.
fn work(base: &Arc<CoreState>, job: &Value) -> Result<Work> {
    let job: PlanJob = from_value(job.clone())?;
    let base = base.clone();
    Ok(Box::new(move |context| {
        let task = base.catalogue.task(&job.task)?;
        let samples = parameter_samples(&job.task, &job.parameter_source, &job.setup)?;
        let clock = job.seconds.map(|s| RequestDeadline::after(Duration::from_secs_f64(s)));
        let time = RaceBudget { context, clock };
        let found = plan(&task, &samples, &job.setup, &time, context)?;
        base.metrics.count_rollouts(found.rollouts as u64);
        Ok(WorkOutcome::Done(to_value(&document(&found, &job.setup, &samples))?))
    }))
}

/// The job's cancellation combined with the time limit of the search.
struct RaceBudget<'a> {
    context: &'a JobContext<'a>,
    clock: Option<Arc<RequestDeadline>>,
}

impl Budget for RaceBudget<'_> {
    fn check(&self) -> Result<()> {
        self.context.check()?;
        self.clock.as_ref().map_or(Ok(()), |clock| clock.check())
    }
}
