//! Branching: snapshots and counterfactual rollouts of simulated worlds.

use super::rollouts::suggest_job;
use crate::error::Result;
use crate::serve::execution_class::ExecutionClass;
use crate::serve::operation::{ACT, JsonBody, Operation, PathId, post};
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{BranchIn, BranchOut, SnapshotIn, SnapshotOut};

/// Operations on snapshots and branches.
pub fn operations() -> Vec<Operation> {
    vec![
        post("snapshot_world", "/v1/worlds/{id}/snapshot", "worlds", ACT)
            .about(
                "Takes a snapshot of a moment in a rollout: the states of the bodies, and a document to branch from. The \
                 document stores\nhow the moment is reached, so it is exact and valid as long as the world. Not counted as an \
                 attempt.",
            )
            .errors(&[
                (403, "The world is real or sealed"),
                (404, "Unknown world or task"),
                (409, "No step made, or no current task"),
            ])
            .compute_handler(snapshot),
        post("branch_world", "/v1/worlds/{id}/branch", "worlds", ACT)
            .about(
                "Continues from a snapshot with interventions: a counterfactual rollout. Without interventions it is \
                 bit-identical to the\nuninterrupted rollout. Counts as an attempt. For many branches at once use `rollout_world` \
                 with `interventions`.",
            )
            .errors(&[(403, "The world is real or sealed"), (404, "Unknown world or task")])
            .classified_handler(|_, _| ExecutionClass::Streaming, branch),
    ]
}

fn snapshot(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<SnapshotIn>),
) -> Result<SnapshotOut> {
    let world = app.worlds().get(&id)?.world;
    let (snapshot, reached) = world.snapshot(&id, body.request()?, app.budget()).map_err(suggest_job)?;
    Ok(SnapshotOut::new(snapshot, &reached))
}

fn branch(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<BranchIn>),
) -> Result<BranchOut> {
    let world = app.worlds().get(&id)?.world;
    let (snapshot, changes) = body.parts()?;
    let branched = world.branch(&id, &snapshot, changes, app.budget()).map_err(suggest_job)?;
    app.metrics.count_attempts(world.kind(), 1, u64::from(branched.trajectory.outcome.steps));
    Ok(BranchOut::new(snapshot.at, branched))
}
