//! The batched engine: scenes of discs among statics of any shape, eight rollouts at a time in f64.
//!
//! Source: the scheme of Chipmunk2D as Pymunk 7 runs it by default (see `kernel`); trajectories agree with
//! Pymunk's to a centimetre for seconds. Rollouts of one *topology* (the same number of bodies, the same kinds of
//! statics, effects and goal, one time step) share a batch; everything else is each lane's own.
//!
//! Results do not depend on the number of threads, on which rollouts share a batch, on lanes, or on the
//! instruction set: lanes never exchange anything, and no product is fused with a sum.
//!
//! Differences from the source:
//! - The first step moves bodies at their initial speeds and then accelerates them, as in Pymunk; the rapier
//!   engine accelerates first. Both are of first order in the time step.
//! - A disc fast enough to pass through a static in one step is stopped at it: see `tunnel`.
//! - Overlap is tolerated up to Chipmunk's 0.1 m only for bodies larger than 0.6 m across; less for smaller.

mod batch;
mod contact;
mod count;
mod kernel;
mod level;
mod rest;
mod simd;
mod touch;
mod tunnel;

use super::goal::Condition;
use super::prepare::Prepared;
use crate::trajectory::Trajectory;
pub use count::{Operations, operations};
pub use level::Level;

/// Where rollouts of one topology come from and where their trajectories go.
pub trait Feed {
    /// The next rollout and its number.
    fn next(&mut self) -> Option<(usize, Prepared)>;
    /// Takes in a finished one.
    fn done(&mut self, index: usize, trajectory: Trajectory);
}

/// How a batch is run; neither changes any result.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Instructions to use.
    pub level: Level,
    /// Whether a lane in which nothing changes any more is ended by filling in the rest.
    pub end_at_rest: bool,
}

/// Integrates everything that `feed` holds.
pub fn run(feed: &mut dyn Feed, settings: Settings) {
    level::run(feed, settings);
}

/// Whether this engine takes the scene: every movable body is a disc.
pub fn takes(prepared: &Prepared) -> bool {
    prepared.bodies.iter().all(|b| b.shape.disc_radius().is_some())
}

/// What rollouts must have in common to share a batch.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Topology {
    bodies: usize,
    /// Corners of each piece of each static, with the static's number; 0 for a half plane.
    statics: Vec<(usize, usize)>,
    effects: Vec<&'static str>,
    /// Bits of the time step.
    time_step: u64,
    goal: Option<(usize, usize, usize)>,
}

impl Topology {
    /// The topology of a rollout.
    pub fn of(prepared: &Prepared) -> Topology {
        let count = prepared.bodies.len();
        Topology {
            bodies: count,
            statics: batch::pieces(prepared).map(|(s, piece)| (s, piece.corners())).collect(),
            effects: prepared.effects.clone(),
            time_step: prepared.time_step.to_bits(),
            goal: prepared.goal.as_ref().map(|g| match &g.condition {
                Condition::Inside { body, .. } => (0, *body, 0),
                Condition::Contact { parties, .. } => {
                    let [a, b] = parties.map(|p| match p {
                        super::goal::Party::Body(i) => i,
                        super::goal::Party::Static(i) => count + i,
                    });
                    (1, a, b)
                }
            }),
        }
    }
}
