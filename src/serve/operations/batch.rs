//! Batches: many worlds in one request, all of it or nothing.

use super::{Keep, world};
use crate::error::Result;
use crate::serve::app::App;
use crate::serve::wire::{
    CreateWorlds, ResetWorlds, StepWorlds, WorldIds, WorldOut, WorldsMade, WorldsReset, WorldsStepped,
};
use crate::session::{Action, Autoreset, Kind, Listed, reset_many, step_many};

/// Makes worlds.
pub fn create(app: &App, body: CreateWorlds, keep: Keep<WorldsMade>) -> Result<WorldsMade> {
    let (world, seeds) = body.parts()?;
    let config = world.config(&app.catalogue)?;
    let ids: Vec<String> = seeds.iter().map(|_| app.world_id()).collect();
    let out = |made: &[Listed]| WorldsMade {
        worlds: ids.clone(),
        world: WorldOut::new(&made[0].id, made[0].world.describe()),
    };
    let made = app.worlds.make_many(&ids, &config, &seeds, app.now(), &|made| keep(&out(made)))?;
    Ok(out(&made))
}

/// Forgets worlds.
pub fn delete(app: &App, body: WorldIds) -> Result<()> {
    app.worlds.remove_many(&body.checked()?)
}

/// Starts episodes.
pub fn reset(app: &App, body: ResetWorlds) -> Result<WorldsReset> {
    let (ids, resets) = body.parts()?;
    let worlds = app.worlds.get_many(&ids, app.now())?;
    Ok(WorldsReset::new(reset_many(&worlds, &resets)?, worlds[0].features()))
}

/// Carries out one action in each world.
pub fn step(app: &App, body: StepWorlds) -> Result<WorldsStepped> {
    body.checked()?;
    let worlds = app.worlds.get_many(&body.worlds, app.now())?;
    let autoreset = body.autoreset.map_or(Autoreset::Disabled, Autoreset::from);
    let actions: Vec<Action> = body.actions.into_iter().map(Action::from).collect();
    let turned = step_many(&worlds, &actions, autoreset, body.split.map(|s| s.into()))?;
    let mut interactions = Vec::with_capacity(worlds.len());
    let mut attempted = [0, 0];
    for (world, one) in worlds.iter().zip(&turned) {
        interactions.push(one.step.as_ref().map_or_else(|| world.interactions(), |s| s.interactions));
        let valid = one.step.as_ref().is_some_and(|s| s.invalid.is_none());
        attempted[usize::from(world.kind() == Kind::Real)] += u64::from(valid);
    }
    for (kind, n) in [Kind::Sim, Kind::Real].into_iter().zip(attempted) {
        app.metrics.attempted(kind, n);
    }
    Ok(WorldsStepped::new(turned, interactions, autoreset))
}

/// Worlds up to this many make a light batch, if they are light.
pub const FEW: usize = 16;

/// Whether a batch of these worlds takes a fraction of a millisecond.
pub fn is_light(app: &App, worlds: &[String]) -> bool {
    worlds.len() <= FEW && world::is_light(app, worlds.iter().map(String::as_str))
}
