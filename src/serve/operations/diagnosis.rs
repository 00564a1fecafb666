//! Diagnoses as jobs: what the simulation gets wrong, from trials sent or from those of an estimation.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::text::json;
use super::trials;
use crate::discover::{Config, diagnose};
use crate::error::{Error, Result};
use crate::job::{New, Outcome, Work};
use crate::json::{from_value, parse};
use crate::reality::trials_from_csv;
use crate::serve::app::{App, Base};
use crate::serve::operation::{Body, Keep, Operation, post};
use crate::serve::wire::{DiagnosisIn, JobOut};
use crate::task::Scene;

/// What can be asked about what a simulation gets wrong.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_diagnosis", "/v1/diagnoses", "workflow")
            .about(
                "Diagnoses measured trials: what the simulation gets wrong, by name. A job; its result is an \
                 `iplw.diagnosis/1`\ndocument with the `extended_scene`.",
            )
            .refuses(&[(404, "Unknown job"), (409, "A job without trials")])
            .queues(KIND, begin, work),
    ]
}

const KIND: &str = "diagnose";

/// A diagnosis with everything decided; the texts are files' contents, so that no digit is lost.
#[derive(Serialize, Deserialize)]
struct Plan {
    scene: String,
    trials: String,
    seed: u64,
}

/// Queues a diagnosis.
fn begin(app: &App, Body(body): Body<DiagnosisIn>, keep: Keep<JobOut>) -> Result<JobOut> {
    let (scene, csv) = match (&body.job, body.scene, body.trials) {
        (Some(id), None, None) => (trials::scene(app, id)?, trials::csv(app, id)?),
        (None, Some(scene), Some(csv)) => (scene.0, csv),
        (None, scene, _) => {
            let missing = if scene.is_some() { "trials" } else { "scene" };
            return Err(Error::input(missing, "missing", "a scene and its trials, or the job that has both"));
        }
        (Some(_), ..) => {
            return Err(Error::input("job", "given beside scene or trials", "one or the other"));
        }
    };
    scene.validate().map_err(|e| e.under("scene"))?;
    let count = trials_from_csv(&csv, &scene).map_err(|e| e.under("trials"))?.len();
    let seed = body.seed.unwrap_or(0);
    // What was asked for, without the data themselves.
    let config = json!({ "job": body.job, "scene": scene.name, "trials": count, "seed": seed });
    let plan = json(&Plan { scene: scene.to_json(), trials: csv, seed })?;
    let new = New { kind: KIND, config: &config, plan: &plan, seed };
    Ok(app.jobs.submit(new, &|job| keep(&job.into()))?.into())
}

/// The work of a diagnosis: begun again, it does everything again, and finds the same.
fn work(_: &Arc<Base>, plan: &Value) -> Result<Work> {
    let plan: Plan = from_value(plan.clone())?;
    Ok(Box::new(move |context| {
        let scene: Scene = parse(&plan.scene)?;
        let trials = trials_from_csv(&plan.trials, &scene)?;
        let found = diagnose(&scene, &trials, &Config::standard(plan.seed), context)?;
        let mut result = json(&found.diagnosis)?;
        if let Some(fields) = result.as_object_mut() {
            fields.insert("extended_scene".into(), parse(&found.extended.to_json())?);
        }
        Ok(Outcome::Done(result))
    }))
}
