//! Posterior sampling as a job, from uploaded trials or those of an estimation.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::diagnosis::{FEWER_TRIALS, diagnosis_data};
use super::diagnosis_input::DiagnosisInput;
use super::job::{restartable, submit};
use super::json::to_value;
use crate::commands::{PosteriorRequest, set_calibrate};
use crate::error::Result;
use crate::inference::memory;
use crate::inference::posterior::{PosteriorConfig, PosteriorDocument, posterior};
use crate::job::Work;
use crate::progress::Unreported;
use crate::reality::Trial;
use crate::serve::operation::{ACT, JsonBody, Operation, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::JobOut;
use crate::task::Scene;

/// Operations on posteriors.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_posterior", "/v1/posteriors", "workflow", ACT)
            .about(
                "Samples the posterior of latents and effect parameters given measured trials. A job; its result is an \
                 `iplw.posterior/2`\ndocument with the draws as `columns`, which plans, designs and training take as `posterior`.",
            )
            .errors(&[(404, "Unknown job, latent or effect"), (409, "A job without trials")])
            .links(202, "/v1/posteriors/{id}", "/id")
            .job(KIND, begin, work),
    ]
}

/// Kind of a posterior's job.
const KIND: &str = "posterior";

/// A fully specified posterior.
#[derive(Serialize, Deserialize)]
struct PosteriorJob {
    given: DiagnosisInput,
    config: PosteriorConfig,
}

fn begin(
    app: &RequestContext,
    JsonBody(request): JsonBody<PosteriorRequest>,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let config = request.config()?;
    let (job, seed) = (request.job.clone(), config.seed);
    let (scene, csv, trials) = posterior_data(app, request)?;
    let shown = json!({"job": job, "scene": scene.name, "trials": trials.len(), "calibrate": scene.calibrate, "config": config, "seed": seed});
    let plan = PosteriorJob { given: DiagnosisInput { scene: scene.to_json(), trials: csv, seed }, config };
    submit(app, KIND, &shown, &plan, seed, keep)
}

/// The data of [`diagnosis_data`], with `calibrate` overriding the scene's latents to infer; fails if a posterior of them needs too much memory.
pub(super) fn posterior_data(
    app: &RequestContext,
    mut request: PosteriorRequest,
) -> Result<(Scene, String, Vec<Trial>)> {
    let calibrate = request.calibrate.take();
    let (mut scene, csv, trials) = diagnosis_data(app, request.into_data())?;
    set_calibrate(&mut scene, calibrate)?;
    let estimate = memory::posterior(&scene, &trials, &Unreported(app.budget()))?;
    app.shared().limits().request_limits().check_memory(estimate, FEWER_TRIALS)?;
    Ok((scene, csv, trials))
}

/// The work of a posterior. After a restart it starts over and gives the same result.
fn work(base: &Arc<CoreState>, plan: &Value) -> Result<Work> {
    restartable(base, plan, |_, context, plan: &PosteriorJob| {
        let (scene, trials) = plan.given.read(context)?;
        let found = posterior(&scene, &trials, &plan.config, context)?;
        let document = PosteriorDocument::new(&found, &plan.config);
        document.warnings.iter().for_each(|w| context.warn(w));
        to_value(&document)
    })
}
