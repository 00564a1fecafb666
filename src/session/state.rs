//! Mutable state of a world.

use crate::error::Error;
use crate::names::names;
use crate::rng::Stream;
use crate::task::{Split, ValidAction};
use crate::world::Latents;

/// Phase of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Never reset.
    New,
    /// Waiting for an action.
    Ready,
    /// Ended by an attempt.
    Done,
}

/// Mutable state of a world.
pub(super) struct WorldState {
    /// Of a simulation, or of a real world that is not sealed.
    pub(super) latents: Latents,
    pub(super) phase: Phase,
    pub(super) task: Option<usize>,
    /// Split of the last reset; automatic resets draw from it, too.
    pub(super) split: Option<Split>,
    pub(super) episodes: u64,
    /// Valid attempts in the current episode.
    pub(super) attempts: u32,
    pub(super) interactions: u64,
    pub(super) resets: Stream,
    /// The last step whose action could be placed.
    pub(super) last: Option<LastStep>,
}

/// The inputs of a step, sufficient to reproduce its trajectory to the bit.
#[derive(Clone)]
pub(super) struct LastStep {
    /// Index of the task.
    pub(super) task: usize,
    pub(super) action: ValidAction,
    /// Latents at the time of the step.
    pub(super) latents: Latents,
    /// The world's counter after it, which seeds a real world's noise.
    pub(super) interactions: u64,
}

names!(Phase: New = "new", Ready = "ready", Done = "done");

/// Error for a call that the world's state does not allow.
pub(super) fn conflict(reason: &str) -> Error {
    Error::Refused { reason: reason.into() }
}
