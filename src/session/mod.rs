//! Gymnasium's reset and step over a task and a world, without any transport.
//!
//! A [`World`] is what a client acts in: a set of tasks, the physics (a simulation whose latents may be set, or
//! a hidden real one) and the state of the current episode. All of its methods take `&self`: clients may share
//! a world, and counting and episodes stay right.
//!
//! | phase | `step` | after |
//! |---|---|---|
//! | `New` | refused | `reset` makes it `Ready` |
//! | `Ready` | a valid action is an attempt and ends the episode; an unplaceable one changes nothing | `Done` or `Ready` |
//! | `Done` | refused | `reset` makes it `Ready` |
//!
//! Worlds of a [`Registry`] outlive the process: what they are made from is stored when they are made, and a real
//! world's counter before a result of it is given out, so that no interaction that anybody knows of is ever
//! forgotten and a budget never overdrawn. (One whose result was lost with the process had no effect and is not
//! counted.) A simulated world's counter and latents are written within a second. The episode is not kept: a
//! world that comes back waits to be reset.

mod action;
mod attempt;
mod branch;
mod catalogue;
mod config;
mod episode;
mod film;
mod intervened;
mod limits;
mod many;
pub mod observation;
mod registry;
mod saved;
mod sketch;
mod state;
mod told;
mod watch;
mod world;

pub use action::Action;
pub use attempt::{Batch, Keep, Rolled, Tried};
pub use branch::{Asked, Branched, SNAPSHOT_FORMAT, Snapshot};
pub use catalogue::{Catalogue, TaskSet};
pub use config::{Kind, WorldConfig};
pub use episode::{Reset, Start, Step};
pub use limits::{RequestLimits, WORK};
pub use many::{Autoreset, Turned, reset_many, step_many};
pub use registry::{Listed, Registry, RegistryConfig, WorldList};
pub use saved::SavedWorld;
pub use sketch::{Sketch, Sketched, obstacles};
pub use state::Phase;
pub use watch::{Brought, Film, Happened, Way, What, WorldWatcher};
pub use world::{Description, World};
