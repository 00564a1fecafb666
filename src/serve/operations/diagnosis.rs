//! Diagnoses as jobs: what the simulation gets wrong, from trials sent or from those of an estimation.

use std::sync::Arc;

use serde_json::{Value, json};

use super::given::{Given, KIND};
use super::text::json;
use super::trials;
use crate::budget::Budget;
use crate::discover::drawn::drawn;
use crate::discover::{Config, diagnose};
use crate::error::{Error, Result};
use crate::job::{New, Outcome, Work};
use crate::json::{from_value, parse};
use crate::reality::{Of, Reading, gather, trials_from_csv, written};
use crate::serve::app::App;
use crate::serve::operation::{ACT, Body, Keep, Operation, post};
use crate::serve::shared::Base;
use crate::serve::wire::{DiagnosisIn, JobOut};
use crate::task::Scene;
use crate::task::ball::Ball;
use crate::world::effect;

/// What can be asked about what a simulation gets wrong.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_diagnosis", "/v1/diagnoses", "workflow", ACT)
            .about(
                "Diagnoses measured trials: what the simulation gets wrong, by name. A job; its result is an \
                 `iplw.diagnosis/1`\ndocument with the `extended_scene`, the `next_scene` (the next experiment as it \
                 would be simulated, or null)\nand the `evidence`, tables to be drawn. Tracks of one ball need no scene: \
                 `ball` makes it.",
            )
            .refuses(&[(404, "Unknown job"), (409, "A job without trials")])
            .leads_to(202, "/v1/diagnoses/{id}", "/id")
            .queues(KIND, begin, work),
    ]
}

/// Queues a diagnosis.
fn begin(app: &App, Body(body): Body<DiagnosisIn>, keep: Keep<JobOut>) -> Result<JobOut> {
    let (job, seed) = (body.job.clone(), body.seed.unwrap_or(0));
    let (scene, csv, count) = asked(app, body)?;
    // What was asked for, without the data themselves.
    let config = json!({ "job": job, "scene": scene.name, "trials": count, "seed": seed });
    let plan = json(&Given { scene: scene.to_json(), trials: csv, seed })?;
    let new = New { kind: KIND, config: &config, plan: &plan, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// The scene, the trials as CSV and their number, of what was sent or of the job that measured them.
pub(super) fn asked(app: &App, body: DiagnosisIn) -> Result<(Scene, String, usize)> {
    let Some(id) = &body.job else { return sent(body, app.budget()) };
    if body.scene.is_some() || body.ball.is_some() || body.trials.is_some() || body.reading.is_some() {
        let allowed = "one or the other";
        return Err(Error::input("job", "given beside scene, ball, trials or reading", allowed));
    }
    let (scene, csv) = (trials::scene(app, id)?, trials::csv(app, id)?);
    let count = trials_from_csv(&csv, &scene).map_err(|e| e.under("trials"))?.len();
    Ok((scene, csv, count))
}

/// The same of what was sent.
fn sent(body: DiagnosisIn, budget: &dyn Budget) -> Result<(Scene, String, usize)> {
    let scene = body.scene.map(|s| s.0);
    let ball = body.ball.map(|b| Ball::from(b.0));
    let of = match (&scene, &ball) {
        (Some(scene), None) => Of::Scene(scene),
        (None, Some(ball)) => Of::Ball(ball),
        (Some(_), Some(_)) => return Err(Error::input("ball", "given beside scene", "one or the other")),
        (None, None) => {
            let allowed = "a scene (or a ball) and its trials, or the job that has both";
            return Err(Error::input("scene", "missing", allowed));
        }
    };
    let Some(trials) = body.trials else {
        return Err(Error::input("trials", "missing", "a scene and its trials, or the job that has both"));
    };
    if let Some(scene) = &scene {
        scene.validate().and_then(|()| effect::check(&scene.effects)).map_err(|e| e.under("scene"))?;
    }
    let reading = body.reading.map(|r| Reading::from(r.0)).unwrap_or_default();
    let mut files = trials.files("trials");
    if files.is_empty() {
        return Err(Error::input("trials", "empty", "at least one file"));
    }
    let found = gather(&files, of, &reading, budget).map_err(placed)?;
    // Of one file as it should be nothing is rewritten.
    let csv = match found.own_format && files.len() == 1 {
        true => files.swap_remove(0).text,
        false => written(&found.trials, budget)?,
    };
    Ok((found.scene, csv, found.trials.len()))
}

/// An error under the field of the request that it speaks of.
fn placed(error: Error) -> Error {
    let Error::Input(input) = &error else { return error };
    let within = match input.field.as_str() {
        _ if !input.place.is_empty() => "trials",
        "radius" | "mass" | "gravity" | "floor" => "ball",
        "fps" | "metres_per_pixel" | "length_unit" | "time_unit" | "track" => "reading",
        _ => "trials",
    };
    error.under(within)
}

/// The work of a diagnosis: begun again, it does everything again, and finds the same.
fn work(_: &Arc<Base>, plan: &Value) -> Result<Work> {
    let given: Given = from_value(plan.clone())?;
    Ok(Box::new(move |context| {
        let (scene, trials) = given.read()?;
        let found = diagnose(&scene, &trials, &Config::standard(given.seed), context)?;
        let mut result = json(&found.diagnosis)?;
        if let Some(fields) = result.as_object_mut() {
            fields.insert("extended_scene".into(), parse(&found.extended.to_json())?);
            let next = found.diagnosis.next_experiment.as_ref().and_then(|n| n.scene.as_ref());
            let next: Option<Value> = next.map(|scene| parse(&scene.to_json())).transpose()?;
            fields.insert("next_scene".into(), next.into());
            fields.insert("evidence".into(), json(&drawn(&found.evidence))?);
        }
        Ok(Outcome::Done(result))
    }))
}
