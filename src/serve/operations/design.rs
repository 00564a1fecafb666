//! Experimental design as a job: the most informative experiments for a question under a distribution of worlds.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::job::{restartable, submit};
use super::json::to_value;
use crate::commands::{DesignRequest, design_experiments};
use crate::design::{DesignConfig, screening_worlds};
use crate::error::Result;
use crate::estimate::ParameterSamples;
use crate::job::Work;
use crate::serve::operation::{ACT, JsonBody, Operation, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::JobOut;
use crate::task::family;

/// Operations on experimental designs.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_design", "/v1/designs", "workflow", ACT)
            .about(
                "Selects the most informative experiments for a question under a distribution of worlds. A job; its result is \
                 an\n`iplw.design/1` document: the batch in order, with expected information and its standard error.",
            )
            .errors(&[(404, "Unknown task or effect")])
            .job(KIND, begin, work),
    ]
}

const KIND: &str = "design";

/// A fully specified design.
#[derive(Serialize, Deserialize)]
struct DesignJob {
    task: String,
    /// A posterior document. Default: the prior.
    #[serde(alias = "posterior")]
    posterior: Option<Value>,
    sets: Vec<Vec<String>>,
    setup: DesignConfig,
}

/// Queues a design.
fn begin(
    app: &RequestContext,
    JsonBody(body): JsonBody<DesignRequest>,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    app.catalogue.named(&body.task)?;
    let (setup, sets) = (body.limited_config()?, body.sets()?);
    let job = DesignJob { task: body.task, posterior: body.posterior.map(Value::Object), sets, setup };
    let samples = parameter_samples(&job)?;
    screening_worlds(&samples, &job.setup)?;
    // The request without the draws, which are large.
    let about = json!({"source": samples.source(), "draws": samples.draws().len()});
    let config = json!({"task": job.task, "posterior": about, "sets": job.posterior.is_none().then_some(&job.sets), "config": to_value(&job.setup)?});
    submit(app, KIND, &config, &job, job.setup.seed, keep)
}

fn parameter_samples(job: &DesignJob) -> Result<ParameterSamples> {
    match &job.posterior {
        Some(document) => ParameterSamples::from_value(document.clone()).map_err(|e| e.in_field("posterior")),
        None => {
            let prior = family(job.task.split(':').next().unwrap_or_default())?.prior;
            ParameterSamples::standard_prior(prior, &job.sets, job.setup.seed)
        }
    }
}

/// The work of a design. After a restart it starts over and gives the same result.
fn work(base: &Arc<CoreState>, job: &Value) -> Result<Work> {
    restartable(base, job, |base, context, job: &DesignJob| {
        let tasks = base.catalogue.named(&job.task)?.tasks;
        let found = design_experiments(&tasks, &parameter_samples(job)?, &job.setup, context)?;
        base.metrics.count_rollouts(found.rollouts as u64);
        to_value(&found)
    })
}
