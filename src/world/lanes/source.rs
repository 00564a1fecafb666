//! Source of a batch's rollouts and sink of their trajectories.

use crate::trajectory::Trajectory;
use crate::world::compile::RolloutModel;

/// Supplies rollouts of one topology and receives their trajectories.
pub trait RolloutSource {
    /// The next rollout and its index.
    fn next(&mut self) -> Option<(usize, RolloutModel)>;
    /// Whether to continue; called at intervals of about a millisecond.
    fn should_continue(&mut self) -> bool;
    /// Receives a finished rollout.
    fn done(&mut self, index: usize, trajectory: Trajectory);
}
