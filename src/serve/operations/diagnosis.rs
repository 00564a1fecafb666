//! Diagnosis of model discrepancy as a job, from uploaded trials or those of an estimation.

use std::sync::Arc;

use serde_json::{Value, json};

use super::diagnosis_input::{DiagnosisInput, KIND};
use super::job::{restartable, submit};
use super::json::to_value;
use super::trials;
use crate::budget::Budget;
use crate::commands::{DiagnosisRequest, TrialFiles};
use crate::error::{Error, Result};
use crate::inference::mechanism::{self, MAX_EFFECTS, diagnose_joints};
use crate::inference::{DiagnosisConfig, diagnose, memory};
use crate::job::Work;
use crate::json::{JsonObject, parse};
use crate::progress::Unreported;
use crate::reality::{LoadedTrials, Trial, joint_trials_from_csv, read_trials_csv, write_trials_csv};
use crate::report::diagnosis::DiagnosisDocument;
use crate::serve::operation::{ACT, JsonBody, Operation, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::JobOut;
use crate::task::Scene;

/// Operations on diagnoses.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_diagnosis", "/v1/diagnoses", "workflow", ACT)
            .about(
                "Finds the effects that a simulation lacks, from measured trials. A job; its result is an \
                 `iplw.diagnosis/2`\ndocument with the `extended_scene`, the `next_scene` (the recommended experiment, or \
                 null)\nand the `evidence`, tables for plots. For tracks of one ball give `ball` instead of a scene.\nA \
                 scene with joints needs trials of joint positions and commands; its result is an \
                 `iplw.joint_diagnosis/1` document.",
            )
            .errors(&[(404, "Unknown job"), (409, "A job without trials")])
            .links(202, "/v1/diagnoses/{id}", "/id")
            .job(KIND, begin, work),
    ]
}

/// Queues a diagnosis.
fn begin(
    app: &RequestContext,
    JsonBody(request): JsonBody<DiagnosisRequest>,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    if request.scene.as_ref().is_some_and(|JsonObject(scene)| !scene.joints.is_empty()) {
        return begin_joints(app, &request, keep);
    }
    let (job, seed) = (request.job.clone(), request.seed.unwrap_or(0));
    let (scene, csv, trials) = diagnosis_data(app, request)?;
    let estimate = memory::diagnosis(&scene, &trials, &Unreported(app.budget()))?;
    app.shared().limits().request_limits().check_memory(estimate, FEWER_TRIALS)?;
    // The request without the data, which are large.
    let config = json!({ "job": job, "scene": scene.name, "trials": trials.len(), "seed": seed });
    let plan = DiagnosisInput { scene: scene.to_json(), trials: csv, seed };
    submit(app, KIND, &config, &plan, seed, keep)
}

/// Queues a diagnosis of a scene with joints.
fn begin_joints(
    app: &RequestContext,
    request: &DiagnosisRequest,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let Some(JsonObject(scene)) = &request.scene else {
        return Err(Error::input("scene", "missing", "a scene with joints"));
    };
    let others = [
        ("ball", request.ball.is_some()),
        ("reading", request.reading.is_some()),
        ("job", request.job.is_some()),
    ];
    if let Some((field, _)) = others.into_iter().find(|(_, is_given)| *is_given) {
        return Err(Error::input(field, "given", "absent for a scene with joints"));
    }
    scene.validate().map_err(|e| e.in_field("scene"))?;
    let file = match request.trials.as_ref().map(|TrialFiles(files)| files.as_slice()) {
        Some([file]) => &file.text,
        _ => return Err(Error::input("trials", "missing or several files", "one file of trials")),
    };
    let trials = joint_trials_from_csv(file, scene).map_err(|e| e.in_field("trials"))?;
    let rows = trials.iter().map(|trial| trial.times.len()).sum();
    let estimate = mechanism::memory(rows, scene.joints.len());
    app.shared().limits().request_limits().check_memory(estimate, FEWER_TRIALS)?;
    let seed = request.seed.unwrap_or(0);
    let joints = scene.joints.len();
    let config =
        json!({ "job": null, "scene": scene.name, "joints": joints, "trials": trials.len(), "seed": seed });
    let plan = DiagnosisInput { scene: scene.to_json(), trials: file.clone(), seed };
    submit(app, KIND, &config, &plan, seed, keep)
}

/// Advice for data that need too much memory.
pub(super) const FEWER_TRIALS: &str = "give fewer trials, or leave out observations";

/// The scene and the trials, as CSV too, from the upload or from the job that measured them.
pub(super) fn diagnosis_data(
    app: &RequestContext,
    request: DiagnosisRequest,
) -> Result<(Scene, String, Vec<Trial>)> {
    let Some(id) = &request.job else { return uploaded_data(request, app.budget()) };
    if request.scene.is_some()
        || request.ball.is_some()
        || request.trials.is_some()
        || request.reading.is_some()
    {
        let allowed = "one or the other";
        return Err(Error::input("job", "given together with scene, ball, trials or reading", allowed));
    }
    let (scene, csv) = (trials::scene(app, id)?, trials::csv(app, id)?);
    let trials = read_trials_csv(&csv, &scene, app.budget()).map_err(|e| e.in_field("trials"))?;
    Ok((scene, csv, trials))
}

fn uploaded_data(request: DiagnosisRequest, budget: &dyn Budget) -> Result<(Scene, String, Vec<Trial>)> {
    let LoadedTrials { scene, trials, own_format, .. } = request.load(budget)?;
    let csv = match request.trials {
        // A single file in our own format is stored unchanged.
        Some(TrialFiles(mut files)) if own_format && files.len() == 1 => files.swap_remove(0).text,
        _ => write_trials_csv(&trials, budget)?,
    };
    Ok((scene, csv, trials))
}

/// The work of a diagnosis. After a restart it starts over and gives the same result.
fn work(base: &Arc<CoreState>, plan: &Value) -> Result<Work> {
    restartable(base, plan, |_, context, given: &DiagnosisInput| {
        let scene: Scene = parse(&given.scene)?;
        if !scene.joints.is_empty() {
            let trials = joint_trials_from_csv(&given.trials, &scene)?;
            return to_value(&diagnose_joints(&scene, &trials, MAX_EFFECTS, given.seed, context)?);
        }
        let (scene, trials) = given.read(context)?;
        let found = diagnose(&scene, &trials, &DiagnosisConfig::standard(given.seed), context)?;
        to_value(&DiagnosisDocument::new(&found))
    })
}
