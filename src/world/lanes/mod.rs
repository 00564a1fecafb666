//! The batched engine: bodies among statics, eight rollouts at a time in f64.
//!
//! Discs in contact with discs and statics use the short path (`disc_separation`, `disc_solver`): one point,
//! whose lever arm is parallel to the normal. Bodies of other shapes, and discs in contact with them, use the
//! general path: `outline` (pieces in the world frame), `outline_separation` (separation and contact points),
//! `collision` (pairs and their manifolds), `manifold_solver` (their impulses).
//!
//! Source: the scheme of Chipmunk2D as Pymunk 7 runs it by default (see `kernel`); trajectories agree with
//! Pymunk's to a centimetre for seconds. Rollouts of one *topology* (the same number of bodies, the same
//! kinds of statics, effects and goal, one time step) share a batch; all other numbers are per lane.
//!
//! Results do not depend on the number of threads, on which rollouts share a batch, on lanes, or on the
//! instruction set: lanes never exchange data, and no product is fused with a sum.
//!
//! Code on registers is in always-inlined functions, never in closures: a closure is compiled without the
//! instructions of its level, and calls every operation (five times slower).
//!
//! Differences from the source:
//! - The first step moves bodies at their initial velocities and then accelerates them, as in Pymunk; the
//!   rapier engine accelerates first. Both are of first order in the time step.
//! - Continuous collision detection stops bodies that would pass through a static in one step: discs, and the
//!   inscribed discs of other bodies' pieces: see `continuous_collision`.
//! - Overlap is tolerated up to Chipmunk's 0.1 m only for bodies larger than 0.6 m; less for smaller ones.

mod batch;
mod collision;
mod contact_laws;
mod contact_pair;
mod continuous_collision;
mod disc_separation;
mod disc_solver;
mod exchange;
mod goal;
pub mod gpu;
mod gpu_format;
mod intervene;
mod kernel;
mod load;
mod manifold;
mod manifold_solver;
mod new_contact;
#[cfg(feature = "levels")]
mod operation_count;
mod outline;
mod outline_separation;
mod rest_detection;
pub mod simd;
mod simd_level;
pub mod sincos;
mod source;
mod state;
mod static_piece;
mod topology;
mod warm_start;

use super::compile::RolloutModel;
#[cfg(feature = "levels")]
pub use operation_count::{OperationCounts, operations};
pub use simd_level::{BatchSettings, SimdLevel, run};
pub use source::RolloutSource;
pub use topology::Topology;

/// Maximum number of pairs of pieces if some body is not a disc: the engine stores data for each pair.
pub const MAX_PAIRS: usize = 20_000;

/// Whether this engine supports the scene.
pub fn takes(model: &RolloutModel) -> bool {
    let bodies = &model.bodies;
    let moving: usize = bodies.iter().map(|b| b.shape.0.len()).sum();
    let standing = static_piece::pieces(model).count();
    bodies.iter().all(|b| b.shape.disc_radius().is_some())
        || moving * (moving - 1) / 2 + moving * standing <= MAX_PAIRS
}
