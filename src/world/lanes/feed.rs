//! Where a batch's rollouts come from and where what becomes of them goes.

use crate::trajectory::Trajectory;
use crate::world::prepare::Prepared;

/// Where rollouts of one topology come from and where their trajectories go.
pub trait Feed {
    /// The next rollout and its number.
    fn next(&mut self) -> Option<(usize, Prepared)>;
    /// Whether to go on; asked every now and then.
    fn goes_on(&mut self) -> bool;
    /// Takes in a finished one.
    fn done(&mut self, index: usize, trajectory: Trajectory);
}
