//! Writing a rollout down: samples, contact events and the counts the action groups are made from.
//!
//! Two things begin to touch when they touch after not having touched for [`APART_STEPS`] steps, so that the
//! chatter of a ball coming to rest is one contact, not many.

use super::prepared::Prepared;
pub use super::state::State;
use crate::trajectory::{Contact, End, Outcome, Track, Trajectory};

/// Steps without touch after which a touch counts as a new contact. Shorter counts chatter; longer merges
/// the last quick bounces of a ball into one.
pub const APART_STEPS: u32 = 3;
/// Upward component of a contact normal from which the contact carries the body: cos 60 degrees.
pub const CARRIES: f64 = 0.5;

/// Collects one rollout's record.
pub struct Recorder {
    trajectory: Trajectory,
    time_step: f64,
    names: Vec<String>,
    movable: usize,
    /// Last step at which a pair touched; 0 for never, `first * n + second` with first < second.
    last_touch: Vec<u32>,
    carried: Vec<bool>,
    has_goal: bool,
    solved: bool,
}

impl Recorder {
    /// A recorder with room for all samples.
    pub fn new(prepared: &Prepared) -> Recorder {
        let samples = prepared.schedule.count(prepared.steps);
        let names: Vec<String> = prepared
            .bodies
            .iter()
            .map(|b| b.name.clone())
            .chain(prepared.statics.iter().map(|s| s.name.clone()))
            .collect();
        let bodies = prepared.bodies.iter().map(|b| Track::with_capacity(&b.name, samples)).collect();
        Recorder {
            trajectory: Trajectory { times: Vec::with_capacity(samples), bodies, ..Trajectory::default() },
            time_step: prepared.time_step,
            last_touch: vec![0; prepared.bodies.len() * names.len()],
            movable: prepared.bodies.len(),
            carried: vec![false; prepared.bodies.len()],
            names,
            has_goal: prepared.goal.is_some(),
            solved: false,
        }
    }

    /// Samples all bodies after `step` steps.
    pub fn observe(&mut self, step: u32, states: &[State]) {
        self.trajectory.times.push(f64::from(step) * self.time_step);
        for (track, s) in self.trajectory.bodies.iter_mut().zip(states) {
            track.push(s.position, s.angle, s.velocity, s.omega);
        }
    }

    /// Starts taking in the contacts of a step.
    pub fn begin_step(&mut self) {
        self.carried.fill(false);
    }

    /// `first` and `second` (indices: bodies, then statics) touch in this step; `normal` points from first to
    /// second; `speed` is how fast they approached, m/s.
    pub fn touch(&mut self, step: u32, first: usize, second: usize, normal: [f64; 2], speed: f64) {
        let (a, b) = (first.min(second), first.max(second));
        if a >= self.movable {
            return;
        }
        let last = &mut self.last_touch[a * self.names.len() + b];
        let begins = *last == 0 || step > *last + APART_STEPS;
        *last = step;
        if begins {
            self.begin(step, a, b, speed);
        }
        if b >= self.movable && !self.carried[a] {
            let upward = if first == a { -normal[1] } else { normal[1] };
            if upward > CARRIES {
                self.carried[a] = true;
                self.trajectory.rolling_steps += 1;
            }
        }
    }

    /// `a` and `b` (indices: bodies, then statics; a < b) begin to touch in this step.
    pub fn begin(&mut self, step: u32, a: usize, b: usize, speed: f64) {
        let between = [self.names[a].clone(), self.names[b].clone()];
        self.trajectory.events.push(Contact { time: f64::from(step) * self.time_step, between, speed });
        if b < self.movable {
            self.trajectory.collisions += 1;
        }
    }

    /// Statics carried movable bodies for `steps` steps, beyond what `touch` was told.
    pub fn rolled(&mut self, steps: u32) {
        self.trajectory.rolling_steps += steps;
    }

    /// The goal has been reached.
    pub fn solved(&mut self) {
        self.solved = true;
    }

    /// The finished record.
    pub fn finish(mut self, steps: u32, end: End) -> Trajectory {
        self.trajectory.outcome = Outcome { solved: self.has_goal.then_some(self.solved), steps, end };
        self.trajectory
    }
}
