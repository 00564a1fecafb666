//! Trials of an estimation.

use super::estimation::{self, EstimationJob};
use crate::error::{Error, Result};
use crate::json::{from_value, parse};
use crate::reality::{Trial, trials_to_csv, with_trial_settings};
use crate::serve::operation::{
    Extractor, HandlerOutput, MediaBody, Operation, OperationDoc, OperationRequest, OperationResponse,
    Pagination, PathId, Payload, READ, get,
};
use crate::serve::problem::HandlerResult;
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{TrialOut, TrialsPage};
use crate::task::{Placement, Scene};

/// Operations on the trials of an estimation.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_trials", "/v1/jobs/{id}/trials", "jobs", READ)
            .about(
                "Returns the trials of an estimation, measured or submitted: as JSON pages with their scene, or as the \
                 files of\n`iplw measure`, `format=csv` (trials.csv) and `format=scene` (scene.json), unpaged.",
            )
            .response::<TrialsPage>(200, "")
            .media_response(200, "", &["text/csv"])
            .errors(&[(404, ""), (409, "The job is not an estimation")])
            .handler(trials),
    ]
}

/// Requested format of trials.
enum TrialsFormat {
    Json(Pagination),
    Csv,
    Scene,
}

impl Extractor for TrialsFormat {
    fn describe(to: &mut OperationDoc) {
        to.query::<String>("format", "`json` (default), `csv` or `scene`");
        Pagination::describe(to);
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<TrialsFormat> {
        let mut query = from.query()?;
        let at = query.iter().position(|(name, _)| name == "format");
        let format = at.map(|i| query.remove(i).1);
        let whole = match format.as_deref() {
            None | Some("json") => return Ok(TrialsFormat::Json(Pagination::from_query(&query)?)),
            Some("csv") => TrialsFormat::Csv,
            Some("scene") => TrialsFormat::Scene,
            Some(other) => {
                return Err(Error::input("format", format!("{other:?}"), "json, csv or scene").into());
            }
        };
        match query.first() {
            None => Ok(whole),
            Some((name, value)) => {
                let allowed = format!("no such parameter: {} is not paged", format.unwrap_or_default());
                Err(Error::input(name, format!("{value:?}"), allowed).into())
            }
        }
    }
}

fn trials(app: &RequestContext, (PathId(id), form): (PathId, TrialsFormat)) -> Result<OperationResponse> {
    Ok(match form {
        TrialsFormat::Json(of) => page(app, &id, &of)?.into_response(),
        TrialsFormat::Scene => OperationResponse::ok(Payload::Value(Box::new(scene(app, &id)?))),
        TrialsFormat::Csv => {
            MediaBody { kind: "text/csv; charset=utf-8", bytes: csv(app, &id)?.into_bytes() }.into_response()
        }
    })
}

/// A page of the trials with their scene.
fn page(app: &RequestContext, id: &str, page: &Pagination) -> Result<TrialsPage> {
    let after: Option<u64> = page.after(id)?;
    let mut found = measured_trials(app, id, after.map_or(0, |n| n + 1), page.fetch_limit())?;
    let next = page.truncate(id, &mut found, |t| t.proposal);
    let (scene, trials) = with_common_scene(found.iter().map(|f| f.trial.clone()).collect())?;
    let out = |(trial, f): (Trial, MeasuredTrial)| TrialOut {
        bodies: trial.observed.bodies.iter().map(|t| (t.name.clone(), t.into())).collect(),
        trial: trial.name,
        proposal: f.proposal,
        round: f.round,
        task: f.task,
        action: f.action,
        t: trial.observed.times,
    };
    Ok(TrialsPage { scene, trials: trials.into_iter().zip(found).map(out).collect(), next })
}

/// All trials as a trials file.
pub fn csv(app: &RequestContext, id: &str) -> Result<String> {
    let found = measured_trials(app, id, 0, usize::MAX)?;
    Ok(trials_to_csv(&with_common_scene(found.into_iter().map(|f| f.trial).collect())?.1))
}

/// The scene of the trials file.
pub fn scene(app: &RequestContext, id: &str) -> Result<Scene> {
    let found = measured_trials(app, id, 0, usize::MAX)?;
    let scene = with_common_scene(found.into_iter().map(|f| f.trial).collect())?.0;
    scene.ok_or_else(|| Error::Refused { reason: format!("nothing has been measured for {id} yet") })
}

struct MeasuredTrial {
    proposal: u64,
    round: u64,
    task: String,
    action: Vec<f64>,
    trial: Trial,
}

/// At most `most` trials of proposals from number `first` on.
fn measured_trials(app: &RequestContext, id: &str, first: u64, limit: usize) -> Result<Vec<MeasuredTrial>> {
    let row = app.jobs().get(id)?.row;
    if row.kind != estimation::KIND || row.plan.is_null() {
        return Err(Error::Refused { reason: format!("{id} is not an estimation with stored trials") });
    }
    let plan: EstimationJob = from_value(row.plan)?;
    let tasks = plan.tasks(&app.catalogue)?;
    let outcomes = app.store().measured(row.number, first)?;
    let mut found = Vec::new();
    for round in app.store().rounds(row.number)? {
        for p in estimation::parse_pending_round(&round.asked)?.proposals {
            let Some(Some(text)) = outcomes.get(&p.number) else { continue };
            if found.len() == limit {
                return Ok(found);
            }
            let task = &tasks.tasks[tasks.find(&p.task)?];
            let Placement::Valid(scene) = task.place(&p.action_on(task)?) else { continue };
            let trial = Trial {
                name: format!("{}/{}", p.task, p.number),
                setting: None,
                scene: *scene,
                observed: parse(text)?,
            };
            found.push(MeasuredTrial {
                proposal: p.number,
                round: round.number,
                task: p.task,
                action: p.action,
                trial,
            });
        }
    }
    Ok(found)
}

/// Trials with a common scene that has one setting per trial; no scene without trials.
fn with_common_scene(trials: Vec<Trial>) -> Result<(Option<Scene>, Vec<Trial>)> {
    let Some(first) = trials.first() else { return Ok((None, trials)) };
    let (scene, trials) = with_trial_settings(&first.scene.clone(), trials)?;
    Ok((Some(scene), trials))
}
