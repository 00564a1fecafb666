//! Snapshots and branches.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::action::ActionIn;
use super::asked::TrackOut;
use super::bulk::Bulk;
use super::episode::end_name;
use super::intervention::{InterventionIn, interventions};
use super::rollout::ContactsOut;
use super::strict::Object;
use crate::error::Result;
use crate::session::{Asked, Branched, Snapshot};
use crate::task::Intervention;
use crate::trajectory::{Track, Trajectory};

/// The moment to make a snapshot of.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SnapshotIn {
    /// The last step's, with the latents that it was made with, if absent.
    pub action: Option<ActionIn>,
    /// Id of the task; the current one if absent.
    pub task: Option<String>,
    /// s since the start; the nearest time step.
    pub at: f64,
    /// What is done on the way, up to then.
    #[schema(value_type = Option<Vec<InterventionIn>>)]
    pub interventions: Option<Vec<Object<InterventionIn>>>,
    /// Whether the rollout ends with the goal; default true.
    pub stop: Option<bool>,
}

/// A moment in a rollout.
#[derive(Serialize, ToSchema)]
pub struct SnapshotOut {
    /// An `iplw.snapshot/1` document: to be kept as long as one likes, and to be given to a branch.
    #[schema(value_type = Object)]
    pub snapshot: Snapshot,
    /// s since the start
    pub at: f64,
    /// The same in time steps.
    pub step: u32,
    /// States then, by name of the body; of those that are in the scene.
    pub bodies: BTreeMap<String, StateOut>,
}

/// The state of a body.
#[derive(Serialize, ToSchema)]
pub struct StateOut {
    /// m
    pub position: [f64; 2],
    /// rad
    pub angle: f64,
    /// m/s
    pub velocity: [f64; 2],
    /// rad/s
    pub angular_velocity: f64,
}

/// Another course from a snapshot on.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BranchIn {
    /// As it was answered; of this world.
    #[schema(value_type = Object)]
    pub snapshot: Object<Snapshot>,
    /// What is done from then on, in this order where moments are the same; nothing makes the uninterrupted rollout.
    #[schema(value_type = Option<Vec<InterventionIn>>)]
    pub interventions: Option<Vec<Object<InterventionIn>>>,
}

/// A rollout with something else done in it, from its start.
#[derive(Serialize, ToSchema)]
pub struct BranchOut {
    /// Engine that ran.
    pub engine: &'static str,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// Moment of the snapshot, s since the start.
    pub at: f64,
    pub solved: Option<bool>,
    /// Simulated time steps.
    pub steps: u32,
    /// `goal`, `horizon` or `diverged`.
    pub end: &'static str,
    pub contacts: ContactsOut,
    /// Observation times, s.
    pub t: Vec<f64>,
    /// By body name, a state for each time; `null` while the body is not in the scene.
    pub bodies: BTreeMap<String, TrackOut>,
}

impl SnapshotIn {
    /// What is asked for.
    pub fn asked(self) -> Result<Asked> {
        Ok(Asked {
            action: self.action.map(Into::into),
            task: self.task,
            stop: self.stop.unwrap_or(true),
            interventions: interventions(self.interventions.unwrap_or_default(), None, "interventions")?,
            at: self.at,
        })
    }
}

impl BranchIn {
    /// The snapshot, and what is done from it on.
    pub fn parts(self) -> Result<(Snapshot, Vec<Intervention>)> {
        let Object(snapshot) = self.snapshot;
        let given = self.interventions.unwrap_or_default();
        let changes = interventions(given, Some(snapshot.at), "interventions")?;
        Ok((snapshot, changes))
    }
}

impl SnapshotOut {
    /// A snapshot with the last states of the rollout up to it.
    pub fn new(snapshot: Snapshot, reached: &Trajectory) -> SnapshotOut {
        let state = |track: &Track| {
            let k = track.len().checked_sub(1)?;
            let state = StateOut {
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
    /// A branch from a moment.
    pub fn new(at: f64, branched: Branched) -> BranchOut {
        let Branched { engine, interactions, trajectory: t } = branched;
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

impl Bulk for SnapshotOut {}
impl Bulk for BranchOut {}
