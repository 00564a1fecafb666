//! Likelihoods for samplers of one's own: prepared as a job, then asked at as many points as one likes.
//!
//! What was prepared is kept as long as there is room. After that, or after a restart, whoever asks next waits until it is prepared
//! again, with the same bits; if that takes longer than a request may, it goes on and is there when it is asked for again.

use std::sync::Arc;

use ring::digest::{SHA256, digest};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::given::Given;
use super::posterior::asked_about;
use super::text::{json, text};
use crate::discover::posterior::{Likelihood, PosteriorConfig};
use crate::error::{Error, Result};
use crate::job::{New, Outcome, Work};
use crate::json::from_value;
use crate::progress::{Progress, Silent};
use crate::serve::app::App;
use crate::serve::operation::{ACT, Body, Id, Keep, Operation, post};
use crate::serve::shared::Base;
use crate::serve::wire::{Densities, JobOut, LikelihoodIn, PointsIn, Starts, StartsIn};
use crate::store::JobState;

/// What can be asked about how likely trials are.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_likelihood", "/v1/likelihoods", "workflow", ACT)
            .about(
                "Prepares the likelihood that posteriors are drawn from, given measured trials, for a sampler of one's own. A job; its \
                 result\nis an `iplw.likelihood/1` document that names the numbers of a point and what is believed of them.",
            )
            .refuses(&[(404, "Unknown job, latent or effect"), (409, "A job without trials")])
            .leads_to(202, "/v1/likelihoods/{id}", "/id")
            .queues(KIND, begin, work),
        post("evaluate_likelihood", "/v1/likelihoods/{id}/evaluate", "workflow", ACT)
            .about(
                "How likely the trials are at each of many points, and what is believed of each: the sum of the two logarithms is the \
                 log\nposterior density but for a constant. A point's numbers are the same bits in whatever company it is asked.",
            )
            .refuses(&[(404, ""), (409, "The job is no likelihood, or not ready"), (413, "")])
            .computes(evaluate),
        post("draw_starts", "/v1/likelihoods/{id}/starts", "workflow", ACT)
            .about("Points about the fit at which chains may begin: each is possible.")
            .refuses(&[(404, ""), (409, "The job is no likelihood, or not ready")])
            .computes(starts),
    ]
}

/// The kind of job.
const KIND: &str = "likelihood";
/// Points that are asked before it is seen whether there is time for more.
const TOGETHER: usize = 64;

/// A likelihood with everything decided.
#[derive(Serialize, Deserialize)]
struct Plan {
    given: Given,
    config: PosteriorConfig,
    /// Digest of both: what is kept goes by it, whoever asks.
    key: String,
}

fn begin(app: &App, Body(body): Body<LikelihoodIn>, keep: Keep<JobOut>) -> Result<JobOut> {
    let (given, wanted, calibrate) = body.parts();
    let config = wanted.config().map_err(named)?;
    let (job, seed) = (given.job.clone(), config.seed);
    let (scene, trials, count) = asked_about(app, given, calibrate)?;
    let shown = json!({
        "job": job, "scene": scene.name, "trials": count, "calibrate": scene.calibrate, "effects": config.sets[0],
        "prior": config.prior, "discrepancy": config.discrepancy, "seed": seed,
    });
    let given = Given { scene: scene.to_json(), trials, seed };
    let key = digest(&SHA256, text(&(&given, &config))?.as_bytes());
    let key = key.as_ref().iter().map(|b| format!("{b:02x}")).collect();
    let plan = json(&Plan { given, config, key })?;
    let new = New { kind: KIND, config: &shown, plan: &plan, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// An error about the only set speaks of the effects.
fn named(error: Error) -> Error {
    match error {
        Error::Input(mut input) if input.field == "sets[0]" => {
            input.field = "effects".into();
            Error::Input(input)
        }
        other => other,
    }
}

/// The work of a likelihood: begun again, it does everything again, and finds the same.
fn work(base: &Arc<Base>, plan: &Value) -> Result<Work> {
    let plan: Plan = from_value(plan.clone())?;
    let base = base.clone();
    Ok(Box::new(move |context| Ok(Outcome::Done(prepared(&base, &plan, context)?.document()))))
}

/// What a plan says, prepared unless it is there.
fn prepared(base: &Base, plan: &Plan, progress: &dyn Progress) -> Result<Arc<Likelihood>> {
    base.likelihoods.get(&plan.key, || {
        let (scene, trials) = plan.given.read()?;
        let found = Likelihood::new(&scene, &trials, &plan.config, progress)?;
        let bytes = found.bytes();
        Ok((found, bytes))
    })
}

/// The likelihood that a job prepared.
fn of_job(app: &App, id: &str) -> Result<Arc<Likelihood>> {
    let row = app.jobs().get(id)?.row;
    if row.kind != KIND {
        return Err(Error::Refused { reason: format!("{id} is no likelihood, but of kind {}", row.kind) });
    }
    if row.state != JobState::Succeeded {
        let reason = format!("{id} is {}; a likelihood can be asked once it has succeeded", row.state.name());
        return Err(Error::Refused { reason });
    }
    prepared(&app.shared().base, &from_value(row.plan)?, &Silent)
}

fn evaluate(app: &App, (Id(id), Body(body)): (Id, Body<PointsIn>)) -> Result<Densities> {
    let likelihood = of_job(app, &id)?;
    let prior_only = body.prior_only;
    let points = body.points(&likelihood.names())?;
    let log_prior = points.iter().map(|p| likelihood.log_prior(p)).collect();
    if prior_only {
        return Ok(Densities::new(log_prior, None));
    }
    let mut found = Vec::with_capacity(points.len());
    for together in points.chunks(TOGETHER) {
        app.budget().look()?;
        found.extend(likelihood.log_likelihoods(together)?);
        app.metrics.simulated((together.len() * likelihood.windows()) as u64);
    }
    Ok(Densities::new(log_prior, Some(found)))
}

fn starts(app: &App, (Id(id), Body(body)): (Id, Body<StartsIn>)) -> Result<Starts> {
    let count = body.count()?;
    let likelihood = of_job(app, &id)?;
    let points = likelihood.starts(count, body.seed.unwrap_or(0))?;
    Ok(Starts::new(likelihood.names(), &points))
}
