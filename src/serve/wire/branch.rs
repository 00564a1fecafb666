//! Snapshots and branches.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::ask_tell::TrackOut;
use super::binary_arrays::BinaryArrays;
use super::episode::end_name;
use super::intervention::{InterventionIn, interventions};
use super::rollout::ContactsOut;
use crate::error::Result;
use crate::json::JsonObject;
use crate::session::{Action, BranchResult, Snapshot, SnapshotRequest};
use crate::task::Intervention;
use crate::trajectory::{Track, Trajectory};

/// The moment to take a snapshot of.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SnapshotIn {
    /// Default: the action of the last step, with its latents.
    pub action: Option<Action>,
    /// Id of the task. Default: the current task.
    pub task: Option<String>,
    /// s since the start, rounded to the nearest time step.
    pub at: f64,
    /// Interventions up to that moment.
    #[schema(value_type = Option<Vec<InterventionIn>>)]
    pub interventions: Option<Vec<JsonObject<InterventionIn>>>,
    /// Whether the rollout ends when the goal is reached. Default: true.
    pub stop: Option<bool>,
}

/// A moment in a rollout.
#[derive(Serialize, ToSchema)]
pub struct SnapshotOut {
    /// An `iplw.snapshot/1` document to pass to `branch_world`; valid as long as the world exists.
    #[schema(value_type = Object)]
    pub snapshot: Snapshot,
    /// s since the start
    pub at: f64,
    /// The same moment in time steps.
    pub step: u32,
    /// States of the bodies in the scene at that moment, by name.
    pub bodies: BTreeMap<String, BodyStateOut>,
}

/// The state of a body.
#[derive(Serialize, ToSchema)]
pub struct BodyStateOut {
    /// m
    pub position: [f64; 2],
    /// rad
    pub angle: f64,
    /// m/s
    pub velocity: [f64; 2],
    /// rad/s
    pub angular_velocity: f64,
}

/// A branch from a snapshot.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BranchIn {
    /// A snapshot of this world, as returned by `snapshot_world`.
    #[schema(value_type = Object)]
    pub snapshot: JsonObject<Snapshot>,
    /// Interventions at or after the snapshot; simultaneous ones apply in this order. None: the uninterrupted rollout.
    #[schema(value_type = Option<Vec<InterventionIn>>)]
    pub interventions: Option<Vec<JsonObject<InterventionIn>>>,
}

/// The branched rollout, from its start.
#[derive(Serialize, ToSchema)]
pub struct BranchOut {
    /// Engine that ran.
    pub engine: &'static str,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// Time of the snapshot, s since the start.
    pub at: f64,
    pub solved: Option<bool>,
    /// Simulated time steps.
    pub steps: u32,
    /// `goal`, `horizon` or `diverged`.
    pub end: &'static str,
    pub contacts: ContactsOut,
    /// Observation times, s.
    pub t: Vec<f64>,
    /// By body name, one state per time; `null` while the body is not in the scene.
    pub bodies: BTreeMap<String, TrackOut>,
}

impl SnapshotIn {
    /// Converts the request.
    pub fn request(self) -> Result<SnapshotRequest> {
        Ok(SnapshotRequest {
            action: self.action,
            task: self.task,
            stop: self.stop.unwrap_or(true),
            interventions: interventions(self.interventions.unwrap_or_default(), None, "interventions")?,
            at: self.at,
        })
    }
}

impl BranchIn {
    /// The snapshot, and the interventions from it on.
    pub fn parts(self) -> Result<(Snapshot, Vec<Intervention>)> {
        let JsonObject(snapshot) = self.snapshot;
        let given = self.interventions.unwrap_or_default();
        let changes = interventions(given, Some(snapshot.at), "interventions")?;
        Ok((snapshot, changes))
    }
}

impl SnapshotOut {
    /// A snapshot with the final states of the rollout up to it.
    pub fn new(snapshot: Snapshot, reached: &Trajectory) -> SnapshotOut {
        let state = |track: &Track| {
            let k = track.len().checked_sub(1)?;
            let state = BodyStateOut {
                position: [track.x[k], track.y[k]],
                angle: track.angle[k],
                velocity: [track.vx[k], track.vy[k]],
                angular_velocity: track.omega[k],
            };
            (!track.x[k].is_nan()).then(|| (track.name.clone(), state))
        };
        let bodies = reached.bodies.iter().filter_map(state).collect();
        SnapshotOut { at: snapshot.at, step: snapshot.step, snapshot, bodies }
    }
}

impl BranchOut {
    /// A branch from time `at`.
    pub fn new(at: f64, branched: BranchResult) -> BranchOut {
        let BranchResult { engine, interactions, trajectory: t } = branched;
        BranchOut {
            engine,
            interactions,
            at,
            solved: t.outcome.solved,
            steps: t.outcome.steps,
            end: end_name(t.outcome.end),
            contacts: ContactsOut { collisions: t.collisions, rolling_steps: t.rolling_steps },
            bodies: t.bodies.iter().map(|b| (b.name.clone(), TrackOut::from(b))).collect(),
            t: t.times,
        }
    }
}

impl BinaryArrays for SnapshotOut {}
impl BinaryArrays for BranchOut {}
