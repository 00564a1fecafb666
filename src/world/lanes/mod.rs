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
#[cfg(feature = "levels")]
mod count;
mod feed;
mod fill;
mod goal;
mod kernel;
mod level;
mod piece;
mod rest;
mod simd;
mod solve;
mod state;
mod topology;
mod touch;
mod tunnel;

use super::prepare::Prepared;
#[cfg(feature = "levels")]
pub use count::{Operations, operations};
pub use feed::Feed;
pub use level::{Level, Settings, run};
pub use topology::Topology;

/// Whether this engine takes the scene: every movable body is a disc.
pub fn takes(prepared: &Prepared) -> bool {
    prepared.bodies.iter().all(|b| b.shape.disc_radius().is_some())
}
