//! Performance surfaces: computed as jobs, stored, and used by estimation strategies that need the importance of latents.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::job::{restartable, submit};
use super::json::{to_json, to_value};
use crate::commands::SurfaceRequest;
use crate::error::{Error, Result};
use crate::estimate::{PerformanceSurface, surface::LatentSensitivity};
use crate::experiment::surface::{SurfaceConfig, surface};
use crate::job::Work;
use crate::json::parse;
use crate::picture::surface::surface_svg;
use crate::progress::Progress;
use crate::serve::operation::{
    ACT, ADMIN, BodyWithJson, MediaBody, Operation, Pagination, PathId, READ, RecordResponse, delete, get,
    post,
};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::{JobOut, SensitivityOut, SurfaceOut, SurfaceWithPoints, SurfacesPage};
use crate::store::{Store, SurfaceRow};
use crate::task::Family;

/// Operations on performance surfaces.
pub fn operations() -> Vec<Operation> {
    vec![
        post("find_surface", "/v1/surfaces", "workflow", ACT)
            .about(
                "Computes how a family's performance depends on the latents. A job; its result names the surface. A stored \
                 surface with\nthe same configuration is reused.",
            )
            .errors(&[(404, "Unknown family")])
            .job(KIND, begin, work),
        get("list_surfaces", "/v1/surfaces", "workflow", READ)
            .about("Lists surfaces, oldest first.")
            .links(200, "/v1/surfaces/{id}", "/surfaces/0/id")
            .handler(list),
        get("get_surface", "/v1/surfaces/{id}", "workflow", READ)
            .about("Returns a surface with its points.")
            .errors(&[(404, "")])
            .handler(one),
        get("draw_surface", "/v1/surfaces/{id}/picture", "workflow", READ)
            .about("Draws a surface as a heat map.")
            .media_response(200, "", &["image/svg+xml"])
            .errors(&[(404, "")])
            .handler(draw),
        delete("delete_surface", "/v1/surfaces/{id}", "workflow", ADMIN)
            .about("Deletes a surface.")
            .errors(&[(404, "")])
            .handler(forget),
    ]
}

const KIND: &str = "surface";

/// A fully specified surface.
#[derive(Serialize, Deserialize)]
struct SurfaceJob {
    task: String,
    setup: SurfaceConfig,
}

/// Queues the computation of a surface.
fn begin(
    app: &RequestContext,
    BodyWithJson(body, config): BodyWithJson<SurfaceRequest>,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let family = crate::task::family(&body.task)?;
    let setup = body.config(family)?;
    let seed = setup.seed;
    submit(app, KIND, &config, &SurfaceJob { task: body.task, setup }, seed, keep)
}

/// The work of a surface; a stored one with the same configuration is reused.
fn work(base: &Arc<CoreState>, plan: &Value) -> Result<Work> {
    restartable(base, plan, |base, context, plan: &SurfaceJob| {
        let family = crate::task::family(&plan.task)?;
        let (number, found) = find(&base.store, family, &plan.setup, Some(context.id), context)?;
        let sensitivities = found.sensitivities(family.prior)?;
        Ok(json!({
            "surface": id(number),
            "sensitivities": sensitivities.iter().map(to_value).collect::<Result<Vec<_>>>()?,
            "config": to_value(&plan.setup)?,
        }))
    })
}

/// The surface with this configuration, from the store if possible.
fn find(
    store: &Store,
    family: &Family,
    setup: &SurfaceConfig,
    job: Option<&str>,
    progress: &dyn Progress,
) -> Result<(i64, PerformanceSurface)> {
    let config = to_json(setup)?;
    if let Some(row) = store.surface_like(family.name, &config)? {
        return Ok((row.number, PerformanceSurface::from_json(&row.body)?));
    }
    let found = surface(family, setup, progress)?;
    let number = store.put_surface(family.name, &config, &found.to_json(), job)?;
    Ok((number, found))
}

/// The surface for an estimation's strategy: the named one, or a default one that is computed once and stored.
pub fn importance(
    store: &Store,
    family: &Family,
    named: Option<&str>,
    progress: &dyn Progress,
) -> Result<PerformanceSurface> {
    match named {
        Some(named) => of_family(store, family, named),
        None => Ok(find(store, family, &SurfaceConfig::quick(family)?, None, progress)?.1),
    }
}

/// A stored surface of this family.
pub fn of_family(store: &Store, family: &Family, named: &str) -> Result<PerformanceSurface> {
    let row = row(store, named)?;
    if row.task != family.name {
        let allowed = format!("a surface of {}", family.name);
        return Err(Error::input("surface", format!("{named:?} of {}", row.task), allowed));
    }
    PerformanceSurface::from_json(&row.body)
}

fn list(app: &RequestContext, page: Pagination) -> Result<SurfacesPage> {
    let after: i64 = page.after("surfaces")?.unwrap_or(0);
    let mut all = app.store().surfaces(after, page.fetch_limit())?;
    let next = page.truncate("surfaces", &mut all, |s| s.number);
    let out = |row: &SurfaceRow| about(row, &PerformanceSurface::from_json(&row.body)?);
    Ok(SurfacesPage { surfaces: all.iter().map(out).collect::<Result<_>>()?, next })
}

fn one(app: &RequestContext, PathId(id): PathId) -> Result<SurfaceWithPoints> {
    let row = row(app.store(), &id)?;
    let surface = PerformanceSurface::from_json(&row.body)?;
    Ok(SurfaceWithPoints { about: about(&row, &surface)?, surface })
}

fn draw(app: &RequestContext, PathId(id): PathId) -> Result<MediaBody> {
    let svg = surface_svg(&PerformanceSurface::from_json(&row(app.store(), &id)?.body)?, &[])?;
    Ok(MediaBody { kind: "image/svg+xml", bytes: svg.into_bytes() })
}

fn forget(app: &RequestContext, PathId(id): PathId) -> Result<()> {
    let gone = number(&id).map_or(Ok(false), |n| app.store().remove_surface(n))?;
    if gone { Ok(()) } else { Err(unknown(&id)) }
}

fn about(row: &SurfaceRow, surface: &PerformanceSurface) -> Result<SurfaceOut> {
    let sensitivities = surface.sensitivities(crate::task::family(&row.task)?.prior)?;
    let out = |s: LatentSensitivity| SensitivityOut { factor: s.factor, slope: s.slope, stake: s.stake };
    Ok(SurfaceOut {
        id: id(row.number),
        task: row.task.clone(),
        route: surface.route.name(),
        points: surface.points.len(),
        config: parse(&row.config)?,
        sensitivities: sensitivities.into_iter().map(out).collect(),
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

/// The surface called `id`.
pub fn stored(store: &Store, id: &str) -> Result<PerformanceSurface> {
    PerformanceSurface::from_json(&row(store, id)?.body)
}

fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "surface", id: id.to_string(), known: Vec::new() }
}
