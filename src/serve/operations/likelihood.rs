//! Likelihoods for external samplers: prepared as a job, then evaluated at any number of points.
//!
//! Prepared likelihoods are cached. After eviction or a restart the next request prepares the likelihood again, with the same
//! bits; that ends with the request's deadline.

use std::sync::Arc;

use ring::digest::{SHA256, digest};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::diagnosis_input::DiagnosisInput;
use super::job::{restartable, submit};
use super::json::to_json;
use super::posterior::posterior_data;
use crate::error::{Error, Result};
use crate::inference::posterior::{PosteriorConfig, TrialLikelihood};
use crate::job::Work;
use crate::json::from_value;
use crate::progress::{Progress, Unreported};
use crate::serve::operation::{ACT, JsonBody, Operation, PathId, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::{ChainStarts, ChainStartsIn, JobOut, LikelihoodIn, LogDensities, PointsIn};
use crate::store::JobState;

/// Operations on likelihoods.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_likelihood", "/v1/likelihoods", "workflow", ACT)
            .about(
                "Prepares the likelihood of measured trials for an external sampler. A job; its result is an `iplw.likelihood/1` \
                 document\nwith the parameters of a point and their priors.",
            )
            .errors(&[(404, "Unknown job, latent or effect"), (409, "A job without trials")])
            .links(202, "/v1/likelihoods/{id}", "/id")
            .job(KIND, begin, work),
        post("evaluate_likelihood", "/v1/likelihoods/{id}/evaluate", "workflow", ACT)
            .about(
                "Evaluates log likelihood and log prior at many points; their sum is the log posterior density up to a constant. \
                 Results\nare bit-identical however points are batched.",
            )
            .errors(&[(404, ""), (409, "The job is not a likelihood, or not ready"), (413, "")])
            .compute_handler(evaluate),
        post("draw_starts", "/v1/likelihoods/{id}/starts", "workflow", ACT)
            .about("Draws starting points of Markov chains around the fit, each with positive density.")
            .errors(&[(404, ""), (409, "The job is not a likelihood, or not ready")])
            .compute_handler(starts),
    ]
}

/// Kind of a likelihood's job.
const KIND: &str = "likelihood";
/// Points evaluated between checks of the deadline.
const POINTS_PER_CHUNK: usize = 64;

/// A fully specified likelihood.
#[derive(Serialize, Deserialize)]
struct LikelihoodJob {
    given: DiagnosisInput,
    config: PosteriorConfig,
    /// Digest of both, the cache key.
    key: String,
}

fn begin(
    app: &RequestContext,
    JsonBody(body): JsonBody<LikelihoodIn>,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let request = body.into_posterior();
    let config = request.config().map_err(with_request_field)?;
    let (job, seed) = (request.job.clone(), config.seed);
    let (scene, csv, trials) = posterior_data(app, request)?;
    let shown = json!({
        "job": job, "scene": scene.name, "trials": trials.len(), "calibrate": scene.calibrate, "effects": config.sets[0],
        "prior": config.prior, "discrepancy": config.discrepancy, "seed": seed,
    });
    let given = DiagnosisInput { scene: scene.to_json(), trials: csv, seed };
    let key = digest(&SHA256, to_json(&(&given, &config))?.as_bytes());
    let key = key.as_ref().iter().map(|b| format!("{b:02x}")).collect();
    let plan = LikelihoodJob { given, config, key };
    submit(app, KIND, &shown, &plan, seed, keep)
}

/// Renames the field of an error about the only set to `effects`.
fn with_request_field(error: Error) -> Error {
    error.map_input(|input| {
        if input.field == "sets[0]" {
            input.field = "effects".into();
        }
    })
}

/// The work of a likelihood. After a restart it starts over and gives the same result.
fn work(base: &Arc<CoreState>, plan: &Value) -> Result<Work> {
    restartable(base, plan, |base, context, plan| Ok(prepare(base, plan, context)?.document()))
}

/// The prepared likelihood, from the cache if possible.
fn prepare(base: &CoreState, plan: &LikelihoodJob, progress: &dyn Progress) -> Result<Arc<TrialLikelihood>> {
    base.likelihoods.get(&plan.key, || {
        let (scene, trials) = plan.given.read(progress)?;
        let found = TrialLikelihood::new(&scene, &trials, &plan.config, progress)?;
        let bytes = found.bytes();
        Ok((found, bytes))
    })
}

/// The likelihood that a job prepared.
fn load_likelihood(app: &RequestContext, id: &str) -> Result<Arc<TrialLikelihood>> {
    let row = app.jobs().get(id)?.row;
    if row.kind != KIND {
        return Err(Error::Refused { reason: format!("{id} is not a likelihood but of kind {}", row.kind) });
    }
    if row.state != JobState::Succeeded {
        let reason =
            format!("{id} is {}; a likelihood can be evaluated once it has succeeded", row.state.name());
        return Err(Error::Refused { reason });
    }
    prepare(&app.shared().core, &from_value(row.plan)?, &Unreported(app.budget()))
}

fn evaluate(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<PointsIn>),
) -> Result<LogDensities> {
    let likelihood = load_likelihood(app, &id)?;
    let prior_only = body.prior_only;
    let points = body.points(&likelihood.names())?;
    let log_prior = points.iter().map(|p| likelihood.log_prior(p)).collect();
    if prior_only {
        return Ok(LogDensities::new(log_prior, None));
    }
    let mut found = Vec::with_capacity(points.len());
    for together in points.chunks(POINTS_PER_CHUNK) {
        app.budget().check()?;
        found.extend(likelihood.log_likelihoods(together, app.budget())?);
        app.metrics.count_rollouts((together.len() * likelihood.segment_count()) as u64);
    }
    Ok(LogDensities::new(log_prior, Some(found)))
}

fn starts(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<ChainStartsIn>),
) -> Result<ChainStarts> {
    let count = body.count()?;
    let likelihood = load_likelihood(app, &id)?;
    let points = likelihood.initial_points(count, body.seed.unwrap_or(0), app.budget())?;
    Ok(ChainStarts::new(likelihood.names(), &points))
}
