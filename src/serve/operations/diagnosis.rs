//! Diagnosis of model discrepancy as a job, from uploaded trials or those of an estimation.

use std::sync::Arc;

use serde_json::{Value, json};

use super::diagnosis_input::{DiagnosisInput, KIND};
use super::json::to_value;
use super::trials;
use crate::budget::Budget;
use crate::discover::plot_tables::plot_tables;
use crate::discover::{DiagnosisConfig, diagnose};
use crate::error::{Error, Result};
use crate::job::{JobSpec, Work, WorkOutcome};
use crate::json::{from_value, parse};
use crate::reality::{Subject, TrackParseOptions, load_tracks, trials_from_csv, write_trials_csv};
use crate::serve::operation::{ACT, JsonBody, Operation, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::{DiagnosisIn, JobOut};
use crate::task::Scene;
use crate::task::ball::BallScene;
use crate::world::effect;

/// Operations on diagnoses.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_diagnosis", "/v1/diagnoses", "workflow", ACT)
            .about(
                "Finds the effects that a simulation lacks, from measured trials. A job; its result is an \
                 `iplw.diagnosis/1`\ndocument with the `extended_scene`, the `next_scene` (the recommended experiment, or \
                 null)\nand the `evidence`, tables for plots. For tracks of one ball give `ball` instead of a scene.",
            )
            .errors(&[(404, "Unknown job"), (409, "A job without trials")])
            .links(202, "/v1/diagnoses/{id}", "/id")
            .job(KIND, begin, work),
    ]
}

/// Queues a diagnosis.
fn begin(
    app: &RequestContext,
    JsonBody(body): JsonBody<DiagnosisIn>,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let (job, seed) = (body.job.clone(), body.seed.unwrap_or(0));
    let (scene, csv, count) = diagnosis_data(app, body)?;
    // The request without the data, which are large.
    let config = json!({ "job": job, "scene": scene.name, "trials": count, "seed": seed });
    let plan = to_value(&DiagnosisInput { scene: scene.to_json(), trials: csv, seed })?;
    let new = JobSpec { kind: KIND, config: &config, plan: &plan, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// The scene, the trials as CSV and their number, from the upload or from the job that measured them.
pub(super) fn diagnosis_data(app: &RequestContext, body: DiagnosisIn) -> Result<(Scene, String, usize)> {
    let Some(id) = &body.job else { return uploaded_data(body, app.budget()) };
    if body.scene.is_some() || body.ball.is_some() || body.trials.is_some() || body.reading.is_some() {
        let allowed = "one or the other";
        return Err(Error::input("job", "given together with scene, ball, trials or reading", allowed));
    }
    let (scene, csv) = (trials::scene(app, id)?, trials::csv(app, id)?);
    let count = trials_from_csv(&csv, &scene).map_err(|e| e.in_field("trials"))?.len();
    Ok((scene, csv, count))
}

/// The scene, the trials as CSV and their number, from the upload.
fn uploaded_data(body: DiagnosisIn, budget: &dyn Budget) -> Result<(Scene, String, usize)> {
    let scene = body.scene.map(|s| s.0);
    let ball = body.ball.map(|b| BallScene::from(b.0));
    let of = match (&scene, &ball) {
        (Some(scene), None) => Subject::Scene(scene),
        (None, Some(ball)) => Subject::Ball(ball),
        (Some(_), Some(_)) => {
            return Err(Error::input("ball", "given together with scene", "one or the other"));
        }
        (None, None) => {
            let allowed = "a scene (or a ball) and its trials, or a job that has both";
            return Err(Error::input("scene", "missing", allowed));
        }
    };
    let Some(trials) = body.trials else {
        return Err(Error::input("trials", "missing", "a scene and its trials, or a job that has both"));
    };
    if let Some(scene) = &scene {
        scene
            .validate()
            .and_then(|()| effect::validate_terms(&scene.effects))
            .map_err(|e| e.in_field("scene"))?;
    }
    let reading = body.reading.map(|r| TrackParseOptions::from(r.0)).unwrap_or_default();
    let mut files = trials.files("trials");
    if files.is_empty() {
        return Err(Error::input("trials", "empty", "at least one file"));
    }
    let found = load_tracks(&files, of, &reading, budget).map_err(with_request_field)?;
    // A single file in our own format is stored unchanged.
    let csv = match found.own_format && files.len() == 1 {
        true => files.swap_remove(0).text,
        false => write_trials_csv(&found.trials, budget)?,
    };
    Ok((found.scene, csv, found.trials.len()))
}

/// Prefixes an error's field with the field of the request it belongs to.
fn with_request_field(error: Error) -> Error {
    let Error::Input(input) = &error else { return error };
    let within = match input.field.as_str() {
        _ if !input.place.is_empty() => "trials",
        "radius" | "mass" | "gravity" | "floor" => "ball",
        "fps" | "metres_per_pixel" | "length_unit" | "time_unit" | "track" => "reading",
        _ => "trials",
    };
    error.in_field(within)
}

/// The work of a diagnosis. After a restart it starts over and gives the same result.
fn work(_: &Arc<CoreState>, plan: &Value) -> Result<Work> {
    let given: DiagnosisInput = from_value(plan.clone())?;
    Ok(Box::new(move |context| {
        let (scene, trials) = given.read()?;
        let found = diagnose(&scene, &trials, &DiagnosisConfig::standard(given.seed), context)?;
        let mut result = to_value(&found.diagnosis)?;
        if let Some(fields) = result.as_object_mut() {
            fields.insert("extended_scene".into(), parse(&found.extended.to_json())?);
            let next = found.diagnosis.next_experiment.as_ref().and_then(|n| n.scene.as_ref());
            let next: Option<Value> = next.map(|scene| parse(&scene.to_json())).transpose()?;
            fields.insert("next_scene".into(), next.into());
            fields.insert("evidence".into(), to_value(&plot_tables(&found.evidence))?);
        }
        Ok(WorkOutcome::Done(result))
    }))
}
