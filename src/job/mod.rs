//! Background jobs: a bounded queue, progress events, and cancellation.
//!
//! States: queued -> running -> succeeded | failed | cancelled. A running job may instead wait for results from outside
//! (running -> waiting -> queued); it occupies no thread meanwhile. Every state but the final ones can be cancelled. Events of a
//! job are numbered from 1 and the last [`MAX_EVENTS_PER_JOB`] are kept, so that a watcher can resume after a lost connection.
//!
//! Jobs survive the process. A factory by kind builds the work from the stored plan, so jobs that had not ended when a server stopped
//! or was killed are queued again at the next start. The work stores its completed parts and decides what to repeat. A job that
//! was started [`MAX_STARTS_WITHOUT_PROGRESS`] times without progress fails, because it may be what ends the server.
//!
//! Every job runs on its own thread and in its own rayon pool: a job waiting in parallel code cannot be handed another job, and
//! requests are not queued behind a job's thousands of rollouts.

mod active;
mod eta;
mod queue;
mod record;
mod runner;
#[cfg(test)]
mod runner_test;
mod state;
mod summary;
mod watch;
mod work;

pub use active::MAX_EVENTS_PER_JOB;
pub use record::{DeleteOutcome, Figure, Job, id};
pub use runner::{JobSpec, Runner};
pub use state::{MAX_STARTS_WITHOUT_PROGRESS, RunnerConfig};
pub use summary::{summarize, summarized_kinds};
pub use watch::Watcher;
pub use work::{JobContext, Work, WorkFactories, WorkFactory, WorkOutcome};
