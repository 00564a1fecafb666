//! Records a rollout: samples, contact events and the counts that the action groups use.
//!
//! A contact begins when two objects touch that have not touched for [`CONTACT_GAP_STEPS`] steps, so that the
//! chatter of a ball coming to rest is one contact.

use super::contact_criteria::{CONTACT_GAP_STEPS, MIN_SUPPORT_NORMAL_Y};
use super::rollout_model::RolloutModel;
pub use super::state::BodyState;
use crate::trajectory::{Contact, RolloutOutcome, Termination, Track, Trajectory};

/// Collects the record of one rollout.
pub struct Recorder {
    trajectory: Trajectory,
    time_step: f64,
    names: Vec<String>,
    records_contacts: bool,
    movable: usize,
    /// Last step at which a pair touched; 0 for never, at `first * n + second` with first < second.
    last_touch: Vec<u32>,
    carried: Vec<bool>,
    has_goal: bool,
    solved: bool,
}

impl Recorder {
    /// A recorder with room for all samples.
    pub fn new(model: &RolloutModel) -> Recorder {
        let samples = model.schedule.count(model.steps);
        let names: Vec<String> = model
            .bodies
            .iter()
            .map(|b| b.name.clone())
            .chain(model.statics.iter().map(|s| s.name.clone()))
            .collect();
        let bodies = model.bodies.iter().map(|b| Track::with_capacity(&b.name, samples)).collect();
        Recorder {
            trajectory: Trajectory { times: Vec::with_capacity(samples), bodies, ..Trajectory::default() },
            time_step: model.time_step,
            last_touch: vec![0; model.bodies.len() * names.len()],
            records_contacts: model.records_contacts,
            movable: model.bodies.len(),
            carried: vec![false; model.bodies.len()],
            names,
            has_goal: model.goal.is_some(),
            solved: false,
        }
    }

    /// Samples all bodies after `step` steps.
    pub fn observe(&mut self, step: u32, states: &[BodyState]) {
        self.trajectory.times.push(f64::from(step) * self.time_step);
        for (track, s) in self.trajectory.bodies.iter_mut().zip(states) {
            track.push(s.position, s.angle, s.velocity, s.omega);
        }
    }

    /// Starts the contacts of a step.
    pub fn begin_step(&mut self) {
        self.carried.fill(false);
    }

    /// Records that `first` and `second` (indices: bodies, then statics) touch in this step; `normal`
    /// points from first to second; `speed` is the approach speed, m/s.
    pub fn record_contact(&mut self, step: u32, first: usize, second: usize, normal: [f64; 2], speed: f64) {
        let (a, b) = (first.min(second), first.max(second));
        if a >= self.movable {
            return;
        }
        let last = &mut self.last_touch[a * self.names.len() + b];
        let begins = *last == 0 || step > *last + CONTACT_GAP_STEPS;
        *last = step;
        if begins {
            self.begin_contact(step, a, b, speed);
        }
        if b >= self.movable && !self.carried[a] {
            let upward = if first == a { -normal[1] } else { normal[1] };
            if upward > MIN_SUPPORT_NORMAL_Y {
                self.carried[a] = true;
                self.trajectory.rolling_steps += 1;
            }
        }
    }

    /// Records that `a` and `b` (indices: bodies, then statics; a < b) begin to touch in this step.
    pub fn begin_contact(&mut self, step: u32, a: usize, b: usize, speed: f64) {
        if self.records_contacts {
            let between = [self.names[a].clone(), self.names[b].clone()];
            self.trajectory.events.push(Contact { time: f64::from(step) * self.time_step, between, speed });
        }
        if b < self.movable {
            self.trajectory.collisions += 1;
        }
    }

    /// Adds contacts of two bodies that are only counted.
    pub fn add_collisions(&mut self, count: u32) {
        self.trajectory.collisions += count;
    }

    /// Adds `steps` steps in which statics supported bodies, in addition to those of recorded contacts.
    pub fn add_rolling_steps(&mut self, steps: u32) {
        self.trajectory.rolling_steps += steps;
    }

    /// Marks the goal as reached.
    pub fn set_solved(&mut self) {
        self.solved = true;
    }

    /// The finished record.
    pub fn finish(mut self, steps: u32, end: Termination) -> Trajectory {
        self.trajectory.outcome = RolloutOutcome { solved: self.has_goal.then_some(self.solved), steps, end };
        self.trajectory
    }
}
