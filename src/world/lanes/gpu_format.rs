//! Numbers of a rollout on a GPU besides its state: settings before it, and its output.
//!
//! An output begins with an [`OutputHead`]; observations follow, each its step and [`STATE_LEN`] numbers a body (x, y,
//! angle, vx, vy, omega); contacts are stored from the end backwards, each of [`CONTACT_LEN`] numbers (step, first and
//! other object, speed).

use super::exchange::Port;

/// Numbers of a body's state in an observation.
pub const STATE_LEN: usize = 6;
/// Numbers of a contact.
pub const CONTACT_LEN: usize = 4;

/// Values of [`OutputHead::end`].
pub const AT_HORIZON: usize = 0;
pub const AT_GOAL: usize = 1;
pub const DIVERGED: usize = 2;

/// Settings of a rollout.
#[derive(Default)]
pub struct RolloutSettings {
    pub steps: usize,
    /// Whether the goal ends the rollout.
    pub stop_at_goal: bool,
    /// Whether contacts are stored, and not only counted.
    pub records_contacts: bool,
    /// Steps between two observations, or 0 if they are listed.
    pub every: usize,
    /// Number of steps that follow as a list.
    pub listed: usize,
}

/// Outcome of a rollout, and the length of its output.
#[derive(Default)]
pub struct OutputHead {
    pub end: usize,
    /// The last step.
    pub step: usize,
    pub solved: bool,
    pub rolling_steps: usize,
    /// Contacts of two bodies.
    pub collisions: usize,
    pub observations: usize,
    pub contacts: usize,
    /// Whether an observation or a contact did not fit.
    pub overflowed: bool,
}

/// Numbers of an observation.
pub fn observation_len(bodies: usize) -> usize {
    1 + STATE_LEN * bodies
}

impl RolloutSettings {
    pub fn exchange(&mut self, port: &mut impl Port) {
        port.wholes([&mut self.steps, &mut self.every, &mut self.listed]);
        port.flags([&mut self.stop_at_goal, &mut self.records_contacts]);
    }
}

impl OutputHead {
    /// Numbers of the head.
    pub const LEN: usize = 8;

    pub fn exchange(&mut self, port: &mut impl Port) {
        port.wholes([&mut self.end, &mut self.step, &mut self.rolling_steps]);
        port.wholes([&mut self.collisions, &mut self.observations, &mut self.contacts]);
        port.flags([&mut self.solved, &mut self.overflowed]);
    }
}
