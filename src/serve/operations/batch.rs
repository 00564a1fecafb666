//! Batches: vector environments, many worlds in one request, all or nothing.

use super::rollouts::suggest_job;
use crate::error::Result;
use crate::serve::execution_class::ExecutionClass;
use crate::serve::operation::{ACT, JsonBody, Operation, RecordResponse, delete, post};
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{
    CreateWorlds, CreatedWorlds, ResetWorlds, ResetWorldsOut, StepWorlds, StepWorldsOut, WorldIds, WorldOut,
};
use crate::session::{ListedWorld, WorldKind, reset_many, step_many};

/// Operations on many worlds at once.
pub fn operations() -> Vec<Operation> {
    vec![
        post("create_worlds", "/v1/batch/worlds", "batch", ACT)
            .about("Creates worlds that differ only in their seeds, all or none.")
            .errors(&[(404, "Unknown task"), (413, ""), (429, "Too many worlds")])
            .links(201, "/v1/worlds/{id}", "/worlds/0")
            .create_handler(201, None, create),
        delete("delete_worlds", "/v1/batch/worlds", "batch", ACT)
            .about("Deletes worlds, all or none.")
            .errors(&[(404, ""), (413, "")])
            .handler(|app, JsonBody(body): JsonBody<WorldIds>| app.worlds().remove_many(&body.checked()?)),
        post("reset_worlds", "/v1/batch/reset", "batch", ACT)
            .about("Resets worlds, or those selected by the mask, all or none.")
            .errors(&[(404, "Unknown world or task"), (413, "")])
            .classified_handler(|app, JsonBody(body): &JsonBody<ResetWorlds>| execution_class(app, &body.worlds), reset),
        post("step_worlds", "/v1/batch/step", "batch", ACT)
            .about(
                "Steps worlds as one batch, one action each. An error names its entry, and then nothing has been done.",
            )
            .errors(&[
                (404, "Unknown world"),
                (409, "Reset that world first"),
                (413, ""),
                (429, "The budget is spent"),
            ])
            .classified_handler(|app, JsonBody(body): &JsonBody<StepWorlds>| execution_class(app, &body.worlds), step),
    ]
}

fn create(
    app: &RequestContext,
    JsonBody(body): JsonBody<CreateWorlds>,
    keep: RecordResponse<CreatedWorlds>,
) -> Result<CreatedWorlds> {
    let (world, seeds) = body.parts()?;
    let config = world.config(&app.catalogue)?;
    let ids_and_seeds: Vec<(String, u64)> =
        seeds.into_iter().map(|seed| (app.worlds().new_id(), seed)).collect();
    let out = |made: &[ListedWorld]| CreatedWorlds {
        worlds: ids_and_seeds.iter().map(|(id, _)| id.clone()).collect(),
        world: WorldOut::of(&made[0], app.describe(&made[0]), made[0].used),
    };
    let made = app.worlds().make_many(&ids_and_seeds, &config, &|made| keep(&out(made)))?;
    Ok(out(&made))
}

fn reset(app: &RequestContext, JsonBody(body): JsonBody<ResetWorlds>) -> Result<ResetWorldsOut> {
    let (ids, resets) = body.parts()?;
    let worlds = app.worlds().get_many(&ids)?;
    Ok(ResetWorldsOut::new(reset_many(&worlds, &resets)?, worlds[0].features()))
}

fn step(app: &RequestContext, JsonBody(body): JsonBody<StepWorlds>) -> Result<StepWorldsOut> {
    body.checked()?;
    let worlds = app.worlds().get_many(&body.worlds)?;
    let autoreset = body.autoreset.unwrap_or_default();
    let turned =
        step_many(&worlds, &body.actions, autoreset, body.split, app.budget()).map_err(suggest_job)?;
    let mut interactions = Vec::with_capacity(worlds.len());
    let mut attempted = [(0, 0); 2];
    for (world, one) in worlds.iter().zip(&turned) {
        interactions.push(one.step.as_ref().map_or_else(|| world.interactions(), |s| s.interactions));
        if let Some(step) = one.step.as_ref().filter(|s| s.invalid.is_none()) {
            let (valid, steps) = &mut attempted[usize::from(world.kind() == WorldKind::Real)];
            *valid += 1;
            *steps += u64::from(step.steps);
        }
    }
    for (kind, (valid, steps)) in [WorldKind::Sim, WorldKind::Real].into_iter().zip(attempted) {
        app.metrics.count_attempts(kind, valid, steps);
    }
    Ok(StepWorldsOut::new(turned, interactions, autoreset))
}

/// Batches of up to this many worlds run inline if each world does.
const MAX_INLINE_WORLDS: usize = 16;

/// Inline if each world runs inline. The handler looks the worlds up again: earlier requests to them may run in between.
pub fn execution_class(app: &RequestContext, worlds: &[String]) -> ExecutionClass {
    let light = |id: &String| app.worlds().get(id).is_ok_and(|l| l.world.runs_inline());
    if worlds.len() <= MAX_INLINE_WORLDS && worlds.iter().all(light) {
        ExecutionClass::Inline
    } else {
        ExecutionClass::Compute
    }
}
