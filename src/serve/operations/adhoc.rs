//! Ad-hoc simulations, without a world.

use crate::error::Result;
use crate::serve::execution_class::ExecutionClass;
use crate::serve::operation::{ACT, JsonBody, Operation, post};
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{PlaceIn, PlacementsOut, SimulateIn, SimulationOut};
use crate::session::placement_errors;

/// Operations that need no world.
pub fn operations() -> Vec<Operation> {
    vec![
        post("simulate", "/v1/simulate", "worlds", ACT)
            .about(
                "Simulates one rollout of a task or scene with given latents and effects. Creates no world and counts no \
                 interaction.\nThe result includes contacts; `observe_every` sets its sampling interval.",
            )
            .errors(&[(404, "Unknown task"), (413, "")])
            .classified_handler(|_, _| ExecutionClass::Streaming, simulate),
        post("place", "/v1/place", "worlds", ACT)
            .about("Checks which actions can be placed in a task or scene, with reasons if not. Nothing is simulated.")
            .errors(&[(404, "Unknown task"), (413, "Too many actions")])
            .handler(place),
    ]
}

fn simulate(app: &RequestContext, JsonBody(body): JsonBody<SimulateIn>) -> Result<SimulationOut> {
    let simulation = body.simulation(&app.catalogue)?;
    Ok(simulation.run(&app.shared().limits().request_limits(), app.budget())?.into())
}

fn place(app: &RequestContext, JsonBody(body): JsonBody<PlaceIn>) -> Result<PlacementsOut> {
    let (scene, actions) = body.read(&app.catalogue)?;
    Ok(PlacementsOut {
        reasons: placement_errors(&scene, &actions, &app.shared().limits().request_limits(), app.budget())?,
    })
}
