//! Worlds.

use crate::error::Result;
use crate::serve::app::App;
use crate::serve::wire::{
    BatchOut, CreateWorld, LatentsIn, ResetIn, ResetOut, RolloutIn, StepIn, StepOut, WorldOut, Worlds,
};
use crate::session::{Batch, World};

/// All worlds.
pub fn list(app: &App) -> Worlds {
    let all = app.worlds.list(app.now());
    Worlds { worlds: all.iter().map(|w| WorldOut::new(&w.id, w.world.describe())).collect() }
}

/// Makes a world.
pub fn create(app: &App, body: CreateWorld) -> Result<WorldOut> {
    let world = World::new(body.config(&app.catalogue)?)?;
    let id = app.world_id();
    let world = app.worlds.add(id.clone(), world, app.now())?;
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

/// Attempts many actions.
pub fn rollout(app: &App, id: &str, body: RolloutIn) -> Result<BatchOut> {
    let world = app.worlds.get(id, app.now())?;
    let batch = Batch::from(body);
    let rolled = world.rollout(&batch)?;
    app.metrics.attempted(world.kind(), rolled.valid);
    Ok(BatchOut::new(rolled, batch.trajectories))
}
