//! The trials an estimation was made from.

use super::estimation::{self, Plan};
use crate::error::{Error, Result};
use crate::json::{from_value, parse};
use crate::reality::{Trial, settled, trials_to_csv};
use crate::serve::app::App;
use crate::serve::operation::{
    Asked, Content, Described, Id, Input, Media, Operation, Output, Page, READ, Reply, get,
};
use crate::serve::problem::Answer;
use crate::serve::wire::{TrialOut, Trials};
use crate::task::{Placement, Scene};

/// What can be asked of the trials of an estimation.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_trials", "/v1/jobs/{id}/trials", "jobs", READ)
            .about(
                "The trials that an estimation measured, or was told. As JSON in pages with the scene they go with; \
                 as the files\nof `iplw measure` with `format=csv` (trials.csv) and `format=scene` (scene.json), \
                 whole.",
            )
            .answers::<Trials>(200, "")
            .answers_media(200, "", &["text/csv"])
            .refuses(&[(404, ""), (409, "The job is no estimation")])
            .does(trials),
    ]
}

/// In which form trials are wanted.
enum Form {
    Json(Page),
    Csv,
    Scene,
}

impl Input for Form {
    fn describe(to: &mut Described) {
        to.query::<String>("format", "`json` (default), `csv` or `scene`");
        Page::describe(to);
    }

    fn read(from: &mut Asked) -> Answer<Form> {
        let mut query = from.query()?;
        let at = query.iter().position(|(name, _)| name == "format");
        let format = at.map(|i| query.remove(i).1);
        let whole = match format.as_deref() {
            None | Some("json") => return Ok(Form::Json(Page::from_query(&query)?)),
            Some("csv") => Form::Csv,
            Some("scene") => Form::Scene,
            Some(other) => {
                return Err(Error::input("format", format!("{other:?}"), "json, csv or scene").into());
            }
        };
        match query.first() {
            None => Ok(whole),
            Some((name, value)) => {
                let allowed = format!("absent: {} comes whole", format.unwrap_or_default());
                Err(Error::input(name, format!("{value:?}"), allowed).into())
            }
        }
    }
}

fn trials(app: &App, (Id(id), form): (Id, Form)) -> Result<Reply> {
    Ok(match form {
        Form::Json(of) => page(app, &id, &of)?.reply(),
        Form::Scene => Reply::of(Content::Value(Box::new(scene(app, &id)?))),
        Form::Csv => Media { kind: "text/csv; charset=utf-8", bytes: csv(app, &id)?.into_bytes() }.reply(),
    })
}

/// A page of the trials, with the scene they go with.
fn page(app: &App, id: &str, page: &Page) -> Result<Trials> {
    let after: Option<u64> = page.after(id)?;
    let mut found = measured(app, id, after.map_or(0, |n| n + 1), page.fetch())?;
    let next = page.cut(id, &mut found, |t| t.proposal);
    let (scene, trials) = joined(found.iter().map(|f| f.trial.clone()).collect())?;
    let out = |(trial, f): (Trial, Found)| TrialOut {
        bodies: trial.observed.bodies.iter().map(|t| (t.name.clone(), t.into())).collect(),
        trial: trial.name,
        proposal: f.proposal,
        round: f.round,
        task: f.task,
        action: f.action,
        t: trial.observed.times,
    };
    Ok(Trials { scene, trials: trials.into_iter().zip(found).map(out).collect(), next })
}

/// All trials as a trials file.
pub fn csv(app: &App, id: &str) -> Result<String> {
    let found = measured(app, id, 0, usize::MAX)?;
    Ok(trials_to_csv(&joined(found.into_iter().map(|f| f.trial).collect())?.1))
}

/// The scene that goes with the trials file.
pub fn scene(app: &App, id: &str) -> Result<Scene> {
    let found = measured(app, id, 0, usize::MAX)?;
    let scene = joined(found.into_iter().map(|f| f.trial).collect())?.0;
    scene.ok_or_else(|| Error::Refused { reason: format!("nothing has been measured for {id} yet") })
}

struct Found {
    proposal: u64,
    round: u64,
    task: String,
    action: Vec<f64>,
    trial: Trial,
}

/// At most `most` trials of proposals from number `first` on.
fn measured(app: &App, id: &str, first: u64, most: usize) -> Result<Vec<Found>> {
    let row = app.jobs().get(id)?.row;
    if row.kind != estimation::KIND || row.plan.is_null() {
        return Err(Error::Refused { reason: format!("{id} is no estimation that keeps its trials") });
    }
    let plan: Plan = from_value(row.plan)?;
    let tasks = app.catalogue.named(&plan.task)?;
    let outcomes = app.store().measured(row.number, first)?;
    let mut found = Vec::new();
    for round in app.store().rounds(row.number)? {
        for p in estimation::asked(&round.asked)?.proposals {
            let Some(Some(text)) = outcomes.get(&p.number) else { continue };
            if found.len() == most {
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
            found.push(Found {
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

/// Trials with the one scene of which each of them is a setting; none without trials.
fn joined(trials: Vec<Trial>) -> Result<(Option<Scene>, Vec<Trial>)> {
    let Some(first) = trials.first() else { return Ok((None, trials)) };
    let (scene, trials) = settled(&first.scene.clone(), trials)?;
    Ok((Some(scene), trials))
}
