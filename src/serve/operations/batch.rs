//! Batches: many worlds in one request, all of it or nothing.

use super::attempts::or_as_a_job;
use crate::error::Result;
use crate::serve::app::App;
use crate::serve::operation::{ACT, Body, Keep, Operation, delete, post};
use crate::serve::weight::Weight;
use crate::serve::wire::{
    CreateWorlds, ResetWorlds, StepWorlds, WorldIds, WorldOut, WorldsMade, WorldsReset, WorldsStepped,
};
use crate::session::{Action, Autoreset, Kind, Listed, reset_many, step_many};

/// What can be asked of many worlds at once.
pub fn operations() -> Vec<Operation> {
    vec![
        post("create_worlds", "/v1/batch/worlds", "batch", ACT)
            .about("Makes many worlds that differ in their seeds; all of them or none.")
            .refuses(&[(404, "Unknown task"), (413, ""), (429, "No room for more worlds")])
            .leads_to(201, "/v1/worlds/{id}", "/worlds/0")
            .makes(201, None, create),
        delete("delete_worlds", "/v1/batch/worlds", "batch", ACT)
            .about("Forgets many worlds; all of them or none.")
            .refuses(&[(404, ""), (413, "")])
            .does(|app, Body(body): Body<WorldIds>| app.worlds().remove_many(&body.checked()?)),
        post("reset_worlds", "/v1/batch/reset", "batch", ACT)
            .about("Starts an episode in each of many worlds (those of the mask); in all of them or none.")
            .refuses(&[(404, "Unknown world or task"), (413, "")])
            .weighed(|app, Body(body): &Body<ResetWorlds>| weight(app, &body.worlds), reset),
        post("step_worlds", "/v1/batch/step", "batch", ACT)
            .about(
                "Carries out one action in each of many worlds, simulated as one batch. An error in any entry names \
                 it, and then\nnothing was done.",
            )
            .refuses(&[
                (404, "Unknown world"),
                (409, "Reset that world first"),
                (413, ""),
                (429, "The budget is spent"),
            ])
            .weighed(|app, Body(body): &Body<StepWorlds>| weight(app, &body.worlds), step),
    ]
}

fn create(app: &App, Body(body): Body<CreateWorlds>, keep: Keep<WorldsMade>) -> Result<WorldsMade> {
    let (world, seeds) = body.parts()?;
    let config = world.config(&app.catalogue)?;
    let ids: Vec<String> = seeds.iter().map(|_| app.worlds().fresh_id()).collect();
    let out =
        |made: &[Listed]| WorldsMade { worlds: ids.clone(), world: WorldOut::of(&made[0], made[0].used) };
    let made = app.worlds().make_many(&ids, &config, &seeds, &|made| keep(&out(made)))?;
    Ok(out(&made))
}

fn reset(app: &App, Body(body): Body<ResetWorlds>) -> Result<WorldsReset> {
    let (ids, resets) = body.parts()?;
    let worlds = app.worlds().get_many(&ids)?;
    Ok(WorldsReset::new(reset_many(&worlds, &resets)?, worlds[0].features()))
}

fn step(app: &App, Body(body): Body<StepWorlds>) -> Result<WorldsStepped> {
    body.checked()?;
    let worlds = app.worlds().get_many(&body.worlds)?;
    let autoreset = body.autoreset.map_or(Autoreset::Disabled, Autoreset::from);
    let actions: Vec<Action> = body.actions.into_iter().map(Action::from).collect();
    let split = body.split.map(|s| s.into());
    let turned = step_many(&worlds, &actions, autoreset, split, app.budget()).map_err(or_as_a_job)?;
    let mut interactions = Vec::with_capacity(worlds.len());
    let mut attempted = [(0, 0); 2];
    for (world, one) in worlds.iter().zip(&turned) {
        interactions.push(one.step.as_ref().map_or_else(|| world.interactions(), |s| s.interactions));
        if let Some(step) = one.step.as_ref().filter(|s| s.invalid.is_none()) {
            let (valid, steps) = &mut attempted[usize::from(world.kind() == Kind::Real)];
            *valid += 1;
            *steps += u64::from(step.steps);
        }
    }
    for (kind, (valid, steps)) in [Kind::Sim, Kind::Real].into_iter().zip(attempted) {
        app.metrics.attempted(kind, valid, steps);
    }
    Ok(WorldsStepped::new(turned, interactions, autoreset))
}

/// Worlds up to this many make a light batch, if they are light.
const FEW: usize = 16;

fn weight(app: &App, worlds: &[String]) -> Weight {
    let light = |id: &String| app.worlds().get(id).is_ok_and(|w| w.is_light());
    if worlds.len() <= FEW && worlds.iter().all(light) { Weight::Light } else { Weight::Heavy }
}
