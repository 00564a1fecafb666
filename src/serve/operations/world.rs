//! Worlds as resources.

use crate::error::Result;
use crate::serve::app::App;
use crate::serve::operation::{
    ACT, Body, Id, Keep, Operation, Page, READ, Raw, Weight, at, delete, get, post,
};
use crate::serve::wire::{
    BatchOut, CreateWorld, LatentsIn, ResetIn, ResetOut, RolloutIn, StepIn, StepOut, WorldOut, Worlds,
};
use crate::session::Batch;

/// What can be asked of one world.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_worlds", "/v1/worlds", "worlds", READ)
            .about("Worlds in order of id.")
            .leads_to(200, "/v1/worlds/{id}", "/worlds/0/id")
            .does(list),
        post("create_world", "/v1/worlds", "worlds", ACT)
            .about("Makes a world; it outlives the server, and goes when nobody has used it for a while.")
            .refuses(&[(404, "Unknown task"), (413, ""), (429, "No room for more worlds")])
            .leads_to(201, "/v1/worlds/{id}", "/id")
            .makes(201, at("Where the world is", |w: &WorldOut| format!("/v1/worlds/{}", w.id)), create),
        get("get_world", "/v1/worlds/{id}", "worlds", READ)
            .about("One world.")
            .refuses(&[(404, "")])
            .weighed(|_, _| Weight::Light, one),
        delete("delete_world", "/v1/worlds/{id}", "worlds", ACT)
            .about("Forgets a world; the default ones come back when the server restarts.")
            .refuses(&[(404, "")])
            .does(|app, Id(id)| app.worlds().remove(&id)),
        post("reset_world", "/v1/worlds/{id}/reset", "worlds", ACT)
            .about("Starts an episode. Without a seed, the world's own sequence of tasks goes on.")
            .refuses(&[(404, "Unknown world or task")])
            .weighed(|app, (Id(id), _)| weight(app, id), reset),
        post("step_world", "/v1/worlds/{id}/step", "worlds", ACT)
            .about(
                "Carries out an action. An action that cannot be placed is an outcome (`valid: false`), not an \
                 attempt.",
            )
            .refuses(&[(404, ""), (409, "Reset the world first"), (429, "The budget is spent")])
            .weighed(|app, (Id(id), _)| weight(app, id), step),
        post("set_latents", "/v1/worlds/{id}/set_latents", "worlds", ACT)
            .about("Sets those latent factors that are given.")
            .refuses(&[(403, "The world is real or sealed"), (404, "")])
            .does(set_latents),
        post("rollout_world", "/v1/worlds/{id}/rollout", "worlds", ACT)
            .about("Attempts many actions at once, leaving the episode as it is.")
            .refuses(&[
                (404, ""),
                (409, "No current task"),
                (413, "Too many actions"),
                (429, "The budget is spent"),
            ])
            .weighed(size, rollout),
    ]
}

fn list(app: &App, page: Page) -> Result<Worlds> {
    let after: String = page.after("worlds")?.unwrap_or_default();
    let mut all = app.worlds().list(&after, page.fetch())?;
    let next = page.cut("worlds", &mut all, |w| w.id.clone());
    Ok(Worlds { worlds: all.iter().map(|w| WorldOut::new(&w.id, w.world.describe())).collect(), next })
}

fn create(app: &App, Body(body): Body<CreateWorld>, keep: Keep<WorldOut>) -> Result<WorldOut> {
    let id = app.worlds().fresh_id();
    let config = body.config(&app.catalogue)?;
    let world = app.worlds().make(&id, config, &|w| keep(&WorldOut::new(&id, w.describe())))?;
    Ok(WorldOut::new(&id, world.describe()))
}

fn one(app: &App, Id(id): Id) -> Result<WorldOut> {
    Ok(WorldOut::new(&id, app.worlds().get(&id)?.describe()))
}

fn reset(app: &App, (Id(id), Body(body)): (Id, Body<ResetIn>)) -> Result<ResetOut> {
    let world = app.worlds().get(&id)?;
    Ok(world.reset(&body.into())?.into())
}

fn step(app: &App, (Id(id), Body(body)): (Id, Body<StepIn>)) -> Result<StepOut> {
    let world = app.worlds().get(&id)?;
    let step = world.step(&body.action.into(), app.budget())?;
    app.metrics.attempted(world.kind(), u64::from(step.invalid.is_none()));
    Ok(step.into())
}

fn set_latents(app: &App, (Id(id), Body(body)): (Id, Body<LatentsIn>)) -> Result<WorldOut> {
    let world = app.worlds().get(&id)?;
    world.set_latents(body.checked("")?)?;
    Ok(WorldOut::new(&id, world.describe()))
}

/// Trajectories come as arrays where those are wanted apart.
fn rollout(app: &App, (Id(id), Body(body), Raw(raw)): (Id, Body<RolloutIn>, Raw)) -> Result<BatchOut> {
    let world = app.worlds().get(&id)?;
    let batch = Batch::from(body);
    let rolled = world.rollout(&batch, app.budget())?;
    app.metrics.attempted(world.kind(), rolled.valid);
    Ok(BatchOut::new(rolled, batch.trajectories, raw))
}

fn size(_: &App, (_, Body(body), _): &(Id, Body<RolloutIn>, Raw)) -> Weight {
    if body.trajectories == Some(true) { Weight::Large } else { Weight::Usual }
}

fn weight(app: &App, id: &str) -> Weight {
    if app.worlds().get(id).is_ok_and(|w| w.is_light()) { Weight::Light } else { Weight::Usual }
}
