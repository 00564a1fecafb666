//! Interventions, snapshots and branches.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::action::ActionIn;
use super::asked::TrackOut;
use super::bulk::Bulk;
use super::episode::end_name;
use super::rollout::ContactsOut;
use super::strict::Object;
use crate::error::{Error, Result};
use crate::session::{Asked, Branched, Snapshot};
use crate::task::Intervention;
use crate::task::scene::{Body, Static};
use crate::trajectory::Trajectory;

/// Something done in the middle of a rollout: at a moment `at`, s since the start (the nearest time step), of which the
/// observation still shows the state before.
#[derive(Clone, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum InterventionIn {
    /// A blow: the velocity changes by impulse / mass at once.
    Impulse {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// Name of a body.
        body: String,
        /// N s; at most 400 m/s times the body's mass.
        impulse: [f64; 2],
        /// Where it acts, m, which also turns the body; at the centre of mass if absent.
        point: Option<[f64; 2]>,
    },
    /// A body is put somewhere, or given another velocity; what is absent stays.
    Set {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// Name of a body.
        body: String,
        /// m
        position: Option<[f64; 2]>,
        /// rad
        angle: Option<f64>,
        /// m/s
        velocity: Option<[f64; 2]>,
        /// rad/s
        angular_velocity: Option<f64>,
    },
    /// A body comes in, with the density and surface that it says.
    Add {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// As `bodies` of an `iplw.scene/1` document has them.
        #[schema(value_type = Object)]
        body: Object<Body>,
    },
    /// Something that never moves comes in.
    AddStatic {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// As `statics` of an `iplw.scene/1` document has them.
        #[serde(rename = "static")]
        #[schema(value_type = Object)]
        fixed: Object<Static>,
    },
    /// A body or a static is taken away.
    Remove {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// Name of a body or a static.
        body: String,
    },
    /// Those latent factors that are given become others.
    Latents {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// kg/m^2
        density: Option<f64>,
        friction: Option<f64>,
        restitution: Option<f64>,
    },
}

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

impl InterventionIn {
    /// The intervention, at `moment` if it does not say when.
    pub fn at(self, moment: Option<f64>) -> Result<Intervention> {
        let when = |at: Option<f64>| {
            at.or(moment)
                .ok_or_else(|| Error::input("at", "missing", "a moment, s since the start of the rollout"))
        };
        Ok(match self {
            InterventionIn::Impulse { at, body, impulse, point } => {
                Intervention::Impulse { at: when(at)?, body, impulse, point }
            }
            InterventionIn::Set { at, body, position, angle, velocity, angular_velocity } => {
                Intervention::Set { at: when(at)?, body, position, angle, velocity, angular_velocity }
            }
            InterventionIn::Add { at, body: Object(body) } => Intervention::Add { at: when(at)?, body },
            InterventionIn::AddStatic { at, fixed: Object(fixed) } => {
                Intervention::AddStatic { at: when(at)?, fixed }
            }
            InterventionIn::Remove { at, body } => Intervention::Remove { at: when(at)?, body },
            InterventionIn::Latents { at, density, friction, restitution } => {
                Intervention::Latents { at: when(at)?, density, friction, restitution }
            }
        })
    }
}

/// Interventions, at `moment` if they do not say when; errors are about `field`.
pub fn interventions(
    given: Vec<Object<InterventionIn>>,
    moment: Option<f64>,
    field: &str,
) -> Result<Vec<Intervention>> {
    let one = |(k, Object(own)): (usize, Object<InterventionIn>)| {
        own.at(moment).map_err(|e| e.under(&format!("{field}[{k}]")))
    };
    given.into_iter().enumerate().map(one).collect()
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
        let state = |track: &crate::trajectory::Track| {
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
