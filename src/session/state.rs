//! Where a world's episodes stand.

use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::error::Error;
use crate::rng::Stream;
use crate::task::{Split, ValidAction};
use crate::world::Latents;

/// Where an episode stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Never reset.
    New,
    /// Waiting for an action.
    Ready,
    /// Ended by an attempt.
    Done,
}

/// What changes in a world.
pub(super) struct State {
    /// Of a simulation, or of a real world that is not sealed.
    pub(super) latents: Latents,
    pub(super) phase: Phase,
    pub(super) task: Option<usize>,
    /// Part of the family that the last reset drew from; an episode begun by itself draws from it too.
    pub(super) split: Option<Split>,
    pub(super) episodes: u64,
    pub(super) interactions: u64,
    pub(super) resets: Stream,
    /// The last action of an episode that could be placed.
    pub(super) last: Option<Made>,
}

/// A step that was made: enough to see again what it brought, to the bit.
#[derive(Clone)]
pub(super) struct Made {
    /// Index of the task.
    pub(super) task: usize,
    pub(super) action: ValidAction,
    /// Those it was made with.
    pub(super) latents: Latents,
    /// The world's counter after it: what a real world's noise is drawn by.
    pub(super) interactions: u64,
}

impl Phase {
    /// The name used on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Phase::New => "new",
            Phase::Ready => "ready",
            Phase::Done => "done",
        }
    }
}

/// The world is not in the state for it.
pub(super) fn refused(reason: &str) -> Error {
    Error::Refused { reason: reason.into() }
}

/// A panic elsewhere leaves the data as it was after the last completed statement: still usable.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
