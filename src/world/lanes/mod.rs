//! The batched engine: bodies among statics, eight rollouts at a time in f64.
//!
//! Discs, and discs on statics, go the short way (`contact`, `solve`): one point, whose arm is along the normal. Bodies of any other
//! shape, and discs that meet them, go the long one: `outline` (pieces where they stand), `closest` (where two come closest),
//! `near` (pairs and their contacts of two points), `press` (their impulses).
//!
//! Source: the scheme of Chipmunk2D as Pymunk 7 runs it by default (see `kernel`); trajectories agree with
//! Pymunk's to a centimetre for seconds. Rollouts of one *topology* (the same number of bodies, the same kinds of
//! statics, effects and goal, one time step) share a batch; everything else is each lane's own.
//!
//! Results do not depend on the number of threads, on which rollouts share a batch, on lanes, or on the
//! instruction set: lanes never exchange anything, and no product is fused with a sum.
//!
//! Whatever works on registers is a function that is always inlined, never a closure: a closure is compiled without the
//! instructions of the level that it is run at, and calls every operation (five times slower).
//!
//! Differences from the source:
//! - The first step moves bodies at their initial speeds and then accelerates them, as in Pymunk; the rapier
//!   engine accelerates first. Both are of first order in the time step.
//! - What is fast enough to pass through a static in one step is stopped at it: a disc, and of any other body the discs within its
//!   pieces: see `tunnel`.
//! - Overlap is tolerated up to Chipmunk's 0.1 m only for bodies larger than 0.6 m across; less for smaller.

mod batch;
mod closest;
mod contact;
#[cfg(feature = "levels")]
mod count;
mod feed;
mod fill;
mod goal;
mod intervene;
mod kernel;
mod level;
mod manifold;
mod near;
mod outline;
mod piece;
mod press;
mod rest;
mod settle;
mod simd;
mod solve;
mod state;
mod topology;
mod touch;
mod touching;
mod tunnel;
mod turn;

use super::prepare::Prepared;
#[cfg(feature = "levels")]
pub use count::{Operations, operations};
pub use feed::Feed;
pub use level::{Level, Settings, run};
pub use topology::Topology;

/// Most pairs of pieces that this engine takes if some body is no disc: it keeps something of each of them.
pub const MOST_PAIRS: usize = 20_000;

/// Whether this engine takes the scene.
pub fn takes(prepared: &Prepared) -> bool {
    let bodies = &prepared.bodies;
    let moving: usize = bodies.iter().map(|b| b.shape.0.len()).sum();
    let standing = piece::pieces(prepared).count();
    bodies.iter().all(|b| b.shape.disc_radius().is_some())
        || moving * (moving - 1) / 2 + moving * standing <= MOST_PAIRS
}
