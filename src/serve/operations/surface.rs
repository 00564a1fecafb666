//! Performance surfaces: found as jobs, kept, used by estimations whose strategy asks what matters.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::text::{json, text};
use crate::error::{Error, Result};
use crate::estimate::surface::{Axis, Route};
use crate::estimate::{Surface, surface::Sensitivity};
use crate::experiment::surface::{SurfaceConfig, surface};
use crate::job::{New, Outcome, Work};
use crate::json::{from_value, parse};
use crate::picture::surface::surface_svg;
use crate::progress::Progress;
use crate::serve::app::App;
use crate::serve::operation::{ACT, ADMIN, Id, Keep, Kept, Media, Operation, Page, READ, delete, get, post};
use crate::serve::shared::Base;
use crate::serve::wire::{JobOut, SensitivityOut, SurfaceIn, SurfaceOut, SurfaceWhole, Surfaces};
use crate::store::{Store, SurfaceRow};
use crate::task::Family;

/// What can be asked of surfaces.
pub fn operations() -> Vec<Operation> {
    vec![
        post("find_surface", "/v1/surfaces", "workflow", ACT)
            .about(
                "Finds out which latents a family's performance depends on. A job; its result names the surface. \
                 What was found in\nthe same way before is not found again.",
            )
            .refuses(&[(404, "Unknown family")])
            .queues(KIND, begin, work),
        get("list_surfaces", "/v1/surfaces", "workflow", READ)
            .about("Surfaces, oldest first.")
            .leads_to(200, "/v1/surfaces/{id}", "/surfaces/0/id")
            .does(list),
        get("get_surface", "/v1/surfaces/{id}", "workflow", READ)
            .about("One surface with its points.")
            .refuses(&[(404, "")])
            .does(one),
        get("draw_surface", "/v1/surfaces/{id}/picture", "workflow", READ)
            .about("A surface as a heat map.")
            .answers_media(200, "", &["image/svg+xml"])
            .refuses(&[(404, "")])
            .does(draw),
        delete("delete_surface", "/v1/surfaces/{id}", "workflow", ADMIN)
            .about("Forgets a surface.")
            .refuses(&[(404, "")])
            .does(forget),
    ]
}

const KIND: &str = "surface";

/// A surface with everything decided.
#[derive(Serialize, Deserialize)]
struct Plan {
    task: String,
    setup: SurfaceConfig,
}

/// Queues the search for a surface.
fn begin(app: &App, Kept(body, config): Kept<SurfaceIn>, keep: Keep<JobOut>) -> Result<JobOut> {
    let family = crate::task::family(&body.task)?;
    let route = match &body.route {
        None => Route::Ideal,
        Some(name) => Route::from_name(name)
            .map_err(|_| Error::input("route", format!("{name:?}"), "\"ideal\" or \"dqn\""))?,
    };
    let mut setup = SurfaceConfig::new(family, route)?;
    let whole = |field: &str, value: u64, low: u64, high: u64| {
        let allowed = || format!("a whole number from {low} to {high}");
        if (low..=high).contains(&value) {
            Ok(value as usize)
        } else {
            Err(Error::input(field, value, allowed()))
        }
    };
    if let Some(points) = body.points {
        setup.points = whole("points", points, 3, 5000)?;
    }
    if let Some(actions) = body.actions {
        let actions = whole("actions", actions, 1, 50_000)?;
        (setup.actions, setup.labels) = (actions, actions);
    }
    if let Some(factors) = &body.factors {
        let axes = factors.iter().map(|f| Axis::of_prior(f, family.prior));
        setup.axes = axes.collect::<Result<_>>().map_err(|e| match e {
            Error::NotFound { id, known, .. } => {
                Error::input("factors", format!("{id:?}"), format!("some of {}", known.join(", ")))
            }
            other => other,
        })?;
        if setup.axes.is_empty() || (1..setup.axes.len()).any(|i| factors[..i].contains(&factors[i])) {
            let allowed = "some of density, friction, restitution, each once";
            return Err(Error::input("factors", format!("{factors:?}"), allowed));
        }
    }
    setup.seed = body.seed.unwrap_or(0);
    setup.validate()?;
    let seed = setup.seed;
    let new = New { kind: KIND, config: &config, plan: &json(&Plan { task: body.task, setup })?, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// The work of a search: what was found in the same way before is taken from the store.
fn work(base: &Arc<Base>, plan: &Value) -> Result<Work> {
    let plan: Plan = from_value(plan.clone())?;
    let base = base.clone();
    Ok(Box::new(move |context| {
        let family = crate::task::family(&plan.task)?;
        let (number, found) = find(&base.store, family, &plan.setup, Some(context.id), context)?;
        let felt = found.sensitivities(family.prior)?;
        Ok(Outcome::Done(json!({
            "surface": id(number),
            "sensitivities": felt.iter().map(json).collect::<Result<Vec<_>>>()?,
            "config": json(&plan.setup)?,
        })))
    }))
}

/// The surface found in this way, from the store if it is there.
fn find(
    store: &Store,
    family: &Family,
    setup: &SurfaceConfig,
    job: Option<&str>,
    progress: &dyn Progress,
) -> Result<(i64, Surface)> {
    let config = text(setup)?;
    if let Some(row) = store.surface_like(family.name, &config)? {
        return Ok((row.number, Surface::from_json(&row.body)?));
    }
    let found = surface(family, setup, progress)?;
    let number = store.put_surface(family.name, &config, &found.to_json(), job)?;
    Ok((number, found))
}

/// What an estimation's strategy is told of importance: the surface it names, or the one that stands in where it
/// names none, which is found once and kept.
pub fn importance(
    store: &Store,
    family: &Family,
    named: Option<&str>,
    progress: &dyn Progress,
) -> Result<Surface> {
    match named {
        Some(named) => of_family(store, family, named),
        None => Ok(find(store, family, &SurfaceConfig::quick(family)?, None, progress)?.1),
    }
}

/// A stored surface, which must be the family's.
pub fn of_family(store: &Store, family: &Family, named: &str) -> Result<Surface> {
    let row = row(store, named)?;
    if row.task != family.name {
        let allowed = format!("a surface of {}", family.name);
        return Err(Error::input("surface", format!("{named:?} of {}", row.task), allowed));
    }
    Surface::from_json(&row.body)
}

fn list(app: &App, page: Page) -> Result<Surfaces> {
    let after: i64 = page.after("surfaces")?.unwrap_or(0);
    let mut all = app.store().surfaces(after, page.fetch())?;
    let next = page.cut("surfaces", &mut all, |s| s.number);
    let out = |row: &SurfaceRow| about(row, &Surface::from_json(&row.body)?);
    Ok(Surfaces { surfaces: all.iter().map(out).collect::<Result<_>>()?, next })
}

fn one(app: &App, Id(id): Id) -> Result<SurfaceWhole> {
    let row = row(app.store(), &id)?;
    let surface = Surface::from_json(&row.body)?;
    Ok(SurfaceWhole { about: about(&row, &surface)?, surface })
}

fn draw(app: &App, Id(id): Id) -> Result<Media> {
    let svg = surface_svg(&Surface::from_json(&row(app.store(), &id)?.body)?, &[])?;
    Ok(Media { kind: "image/svg+xml", bytes: svg.into_bytes() })
}

fn forget(app: &App, Id(id): Id) -> Result<()> {
    let gone = number(&id).map_or(Ok(false), |n| app.store().remove_surface(n))?;
    if gone { Ok(()) } else { Err(unknown(&id)) }
}

fn about(row: &SurfaceRow, surface: &Surface) -> Result<SurfaceOut> {
    let felt = surface.sensitivities(crate::task::family(&row.task)?.prior)?;
    let out = |s: Sensitivity| SensitivityOut { factor: s.factor, slope: s.slope, stake: s.stake };
    Ok(SurfaceOut {
        id: id(row.number),
        task: row.task.clone(),
        route: surface.route.name(),
        points: surface.points.len(),
        config: parse(&row.config)?,
        sensitivities: felt.into_iter().map(out).collect(),
        job: row.job.clone(),
        version: row.version.clone(),
    })
}

fn id(number: i64) -> String {
    format!("surface-{number}")
}

fn number(id: &str) -> Option<i64> {
    let digits = id.strip_prefix("surface-")?;
    digits.bytes().all(|b| b.is_ascii_digit()).then(|| digits.parse().ok())?
}

fn row(store: &Store, id: &str) -> Result<SurfaceRow> {
    let found = number(id).map_or(Ok(None), |n| store.surface(n))?;
    found.ok_or_else(|| unknown(id))
}

fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "surface", id: id.to_string(), known: Vec::new() }
}
