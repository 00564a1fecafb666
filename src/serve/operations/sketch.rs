//! Simulations of nobody's world: for whoever draws, drags and compares.

use crate::error::Result;
use crate::serve::app::App;
use crate::serve::operation::{ACT, Body, Operation, post};
use crate::serve::weight::Weight;
use crate::serve::wire::{PlaceIn, Places, SimulateIn, Simulated};
use crate::session::obstacles;

/// What can be asked of no world.
pub fn operations() -> Vec<Operation> {
    vec![
        post("simulate", "/v1/simulate", "worlds", ACT)
            .about(
                "Simulates one rollout of a task or a scene with the latents and effects given, and forgets it: no world \
                 is made,\nnothing is counted. With the times of contacts, and as finely observed as asked.",
            )
            .refuses(&[(404, "Unknown task"), (413, "")])
            .weighed(|_, _| Weight::Large, simulate),
        post("place", "/v1/place", "worlds", ACT)
            .about("Tells which actions have a place in a task or a scene, and why others have none; nothing is simulated.")
            .refuses(&[(404, "Unknown task"), (413, "Too many actions")])
            .does(place),
    ]
}

fn simulate(app: &App, Body(body): Body<SimulateIn>) -> Result<Simulated> {
    let sketch = body.sketch(&app.catalogue)?;
    Ok(sketch.run(&app.shared().limits.of_request(), app.budget())?.into())
}

fn place(app: &App, Body(body): Body<PlaceIn>) -> Result<Places> {
    let (scene, actions) = body.read(&app.catalogue)?;
    Ok(Places { reasons: obstacles(&scene, &actions, &app.shared().limits.of_request(), app.budget())? })
}
