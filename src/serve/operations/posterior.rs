//! Posteriors as jobs: what is known of latents and effects, from trials sent or from those of an estimation.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::diagnosis::asked;
use super::given::Given;
use super::text::json;
use crate::discover::posterior::{Document, PosteriorConfig, posterior};
use crate::error::Result;
use crate::job::{New, Outcome, Work};
use crate::json::from_value;
use crate::serve::app::App;
use crate::serve::operation::{ACT, Body, Keep, Operation, post};
use crate::serve::shared::Base;
use crate::serve::wire::{DiagnosisIn, JobOut, PosteriorIn};
use crate::task::Scene;
use crate::world::latent::factor_index;

/// What can be asked about what is known.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_posterior", "/v1/posteriors", "workflow", ACT)
            .about(
                "Draws what is known of latents and of effects' parameters from the posterior given measured trials. A job; its \
                 result\nis an `iplw.posterior/1` document, draws as `columns`, which a plan takes as its `belief`.",
            )
            .refuses(&[(404, "Unknown job, latent or effect"), (409, "A job without trials")])
            .leads_to(202, "/v1/posteriors/{id}", "/id")
            .queues(KIND, begin, work),
    ]
}

/// The kind of job.
const KIND: &str = "posterior";

/// A posterior with everything decided.
#[derive(Serialize, Deserialize)]
struct Plan {
    given: Given,
    config: PosteriorConfig,
}

fn begin(app: &App, Body(body): Body<PosteriorIn>, keep: Keep<JobOut>) -> Result<JobOut> {
    let (given, wanted, calibrate) = body.parts();
    let config = wanted.config()?;
    let (job, seed) = (given.job.clone(), config.seed);
    let (scene, trials, count) = asked_about(app, given, calibrate)?;
    let shown = json!({"job": job, "scene": scene.name, "trials": count, "calibrate": scene.calibrate, "config": config, "seed": seed});
    let plan = json(&Plan { given: Given { scene: scene.to_json(), trials, seed }, config })?;
    let new = New { kind: KIND, config: &shown, plan: &plan, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// What was sent or measured, as [`asked`] has it, with the latents that are to be known in place of the scene's.
pub(super) fn asked_about(
    app: &App,
    given: DiagnosisIn,
    calibrate: Option<Vec<String>>,
) -> Result<(Scene, String, usize)> {
    let (mut scene, trials, count) = asked(app, given)?;
    if let Some(latents) = calibrate {
        latents.iter().try_for_each(|name| factor_index(name).map(drop))?;
        scene.calibrate = latents;
        scene.validate().map_err(|e| e.under("scene"))?;
    }
    Ok((scene, trials, count))
}

/// The work of a posterior: begun again, it does everything again, and finds the same.
fn work(_: &Arc<Base>, plan: &Value) -> Result<Work> {
    let plan: Plan = from_value(plan.clone())?;
    Ok(Box::new(move |context| {
        let (scene, trials) = plan.given.read()?;
        let found = posterior(&scene, &trials, &plan.config, context)?;
        let document = Document::new(&found, &plan.config);
        document.warnings.iter().for_each(|w| context.warn(w));
        Ok(Outcome::Done(json(&document)?))
    }))
}
