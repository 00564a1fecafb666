//! Work that takes long: a bounded queue, threads of its own, progress to watch, and a way to stop it.
//!
//! States: queued -> running -> succeeded | failed | cancelled. A running job may instead wait for answers from
//! outside (running -> waiting -> queued); no worker is occupied meanwhile. Every state but the ended ones can
//! be cancelled. A job's events are numbered from 1 and the last [`KEPT_EVENTS`] kept, so that a watcher who lost
//! its connection goes on where it was.
//!
//! Jobs outlive the process. What a job does is made from its stored plan by the recipe of its kind, so whatever
//! had not ended when a server stopped or was killed is queued again at the next start; how much of it is done
//! again is up to the work, which keeps what it has finished in the store. A job that was begun [`MOST_STARTS`]
//! times without getting anywhere fails: it may be what ends the server.
//!
//! Every worker runs its job in a rayon pool of its own: a job that waits in parallel code can then never be
//! handed another job, and single requests are not queued behind a job's thousands of rollouts.

mod live;
mod pace;
mod record;
mod runner;
mod shared;
mod watch;
mod work;

pub use live::KEPT_EVENTS;
pub use record::{Deleted, Figure, Job, id};
pub use runner::{New, Runner};
pub use shared::{MOST_STARTS, RunnerConfig};
pub use watch::Watcher;
pub use work::{Context, Outcome, Recipe, Recipes, Work};
