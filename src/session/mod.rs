//! Gymnasium's reset and step on tasks and worlds, independent of any transport.
//!
//! A [`World`] is an environment: a set of tasks, the physics (a simulation with settable latents, or a hidden real world)
//! and the state of the current episode. All methods take `&self`; clients can share a world safely.
//!
//! | phase | `step` | after |
//! |---|---|---|
//! | `New` | error | `reset` makes it `Ready` |
//! | `Ready` | a valid action is an attempt, which ends the episode if it solves the task or is the last one; an invalid one changes nothing | `Done` or `Ready` |
//! | `Done` | error | `reset` makes it `Ready` |
//!
//! Worlds of a [`Registry`] survive a restart. Their configuration is stored on creation. A real world's counter is stored
//! before any result is returned, so no observed interaction is lost and a budget is never exceeded. (An interaction whose
//! result was lost in a crash is not counted.) A simulated world's counter and latents are written within a second. Episodes
//! are not stored: a restored world must be reset first.

mod action;
mod adhoc;
mod catalogue;
mod config;
mod limits;
pub mod observation;
mod registry;
mod saved;
mod state;
mod watch;
mod world;

pub use action::Action;
pub use adhoc::{AdhocResult, AdhocSimulation, placement_errors};
pub use catalogue::{Catalogue, TaskSet};
pub use config::{WorldConfig, WorldKind};
pub use limits::{BODY_STEPS_LABEL, RequestLimits};
pub use registry::{ListedWorld, Registry, RegistryConfig, WorldList};
pub use saved::SavedWorld;
pub use state::Phase;
pub use watch::{BodyPath, Recording, StepOutcome, WorldEvent, WorldEventKind, WorldWatcher};
pub use world::{
    AttemptResult, Autoreset, BatchStepResult, BranchResult, EpisodeStart, PersistResults, Reset,
    RolloutRequest, RolloutResults, SNAPSHOT_FORMAT, Snapshot, SnapshotRequest, StepResult, World,
    WorldDescription, reset_many, step_many,
};
