//! Branching: a moment of a rollout in a simulated world, something else done there, and on.

use super::attempts::or_as_a_job;
use crate::error::Result;
use crate::serve::app::App;
use crate::serve::operation::{ACT, Body, Id, Operation, post};
use crate::serve::weight::Weight;
use crate::serve::wire::{BranchIn, BranchOut, SnapshotIn, SnapshotOut};

/// What can be asked about the middle of a rollout.
pub fn operations() -> Vec<Operation> {
    vec![
        post("snapshot_world", "/v1/worlds/{id}/snapshot", "worlds", ACT)
            .about(
                "A moment in a rollout: where bodies are then, and a document from which to go on. It says how the moment is \
                 reached,\nso it is exact and lasts as long as its world. It is no attempt.",
            )
            .refuses(&[
                (403, "The world is real or sealed"),
                (404, "Unknown world or task"),
                (409, "No step was made, or no current task"),
            ])
            .computes(snapshot),
        post("branch_world", "/v1/worlds/{id}/branch", "worlds", ACT)
            .about(
                "Goes on from a snapshot with something else done: the counterfactual. Without a change it is the \
                 uninterrupted\nrollout to the bit. An attempt like any other; many at once are `rollout` with `interventions`.",
            )
            .refuses(&[(403, "The world is real or sealed"), (404, "Unknown world or task")])
            .weighed(|_, _| Weight::Large, branch),
    ]
}

fn snapshot(app: &App, (Id(id), Body(body)): (Id, Body<SnapshotIn>)) -> Result<SnapshotOut> {
    let world = app.worlds().get(&id)?;
    let (snapshot, reached) = world.snapshot(&id, body.asked()?, app.budget()).map_err(or_as_a_job)?;
    Ok(SnapshotOut::new(snapshot, &reached))
}

fn branch(app: &App, (Id(id), Body(body)): (Id, Body<BranchIn>)) -> Result<BranchOut> {
    let world = app.worlds().get(&id)?;
    let (snapshot, changes) = body.parts()?;
    let branched = world.branch(&id, &snapshot, changes, app.budget()).map_err(or_as_a_job)?;
    app.metrics.attempted(world.kind(), 1, u64::from(branched.trajectory.outcome.steps));
    Ok(BranchOut::new(snapshot.at, branched))
}
