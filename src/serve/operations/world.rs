//! Worlds.

use super::{Keep, Page};
use crate::error::Result;
use crate::serve::app::App;
use crate::serve::wire::{
    BatchOut, CreateWorld, LatentsIn, ResetIn, ResetOut, RolloutIn, StepIn, StepOut, WorldOut, Worlds,
};
use crate::session::Batch;

/// A page of all worlds.
pub fn list(app: &App, page: &Page) -> Result<Worlds> {
    let after: String = page.after("worlds")?.unwrap_or_default();
    let mut all = app.worlds.list(&after, page.fetch(), app.now())?;
    let next = page.cut("worlds", &mut all, |w| w.id.clone());
    Ok(Worlds { worlds: all.iter().map(|w| WorldOut::new(&w.id, w.world.describe())).collect(), next })
}

/// Makes a world.
pub fn create(app: &App, body: CreateWorld, keep: Keep<WorldOut>) -> Result<WorldOut> {
    let id = app.world_id();
    let config = body.config(&app.catalogue)?;
    let world = app.worlds.make(&id, config, app.now(), &|w| keep(&WorldOut::new(&id, w.describe())))?;
    Ok(WorldOut::new(&id, world.describe()))
}

/// One world.
pub fn get(app: &App, id: &str) -> Result<WorldOut> {
    Ok(WorldOut::new(id, app.worlds.get(id, app.now())?.describe()))
}

/// Forgets a world.
pub fn delete(app: &App, id: &str) -> Result<()> {
    app.worlds.remove(id)
}

/// Starts an episode.
pub fn reset(app: &App, id: &str, body: ResetIn) -> Result<ResetOut> {
    let world = app.worlds.get(id, app.now())?;
    Ok(world.reset(&body.into())?.into())
}

/// Carries out an action.
pub fn step(app: &App, id: &str, body: StepIn) -> Result<StepOut> {
    let world = app.worlds.get(id, app.now())?;
    let step = world.step(&body.action.into())?;
    app.metrics.attempted(world.kind(), u64::from(step.invalid.is_none()));
    Ok(step.into())
}

/// Sets latent factors.
pub fn set_latents(app: &App, id: &str, body: LatentsIn) -> Result<WorldOut> {
    let world = app.worlds.get(id, app.now())?;
    world.set_latents(body.checked("")?)?;
    Ok(WorldOut::new(id, world.describe()))
}

/// Attempts many actions; `raw` gives trajectories as arrays.
pub fn rollout(app: &App, id: &str, body: RolloutIn, raw: bool) -> Result<BatchOut> {
    let world = app.worlds.get(id, app.now())?;
    let batch = Batch::from(body);
    let rolled = world.rollout(&batch)?;
    app.metrics.attempted(world.kind(), rolled.valid);
    Ok(BatchOut::new(rolled, batch.trajectories, raw))
}

/// Whether what is asked of these worlds takes a fraction of a millisecond.
pub fn is_light<'a>(app: &App, mut ids: impl Iterator<Item = &'a str>) -> bool {
    ids.all(|id| app.worlds.get(id, app.now()).is_ok_and(|w| w.is_light()))
}
