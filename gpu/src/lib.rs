//! The batched engine (`src/world/lanes`) with one rollout a thread, for graphics processors.
//!
//! Every module below is a source file of the program, compiled a second time with one lane: physics, contact solver
//! and the laws of effects have one source. Of its own this crate has `run` (the loop over the steps of a rollout) and
//! `device` (the entry points, the allocator). On a processor the same code is a library, which tests compare with the
//! program's engine.

#![cfg_attr(
    target_arch = "nvptx64",
    no_std,
    feature(abi_ptx, stdarch_nvptx, prelude_import, core_float_math)
)]
#![allow(internal_features, reason = "the prelude of code that is written for the standard library")]
#![allow(dead_code, unused_imports, reason = "the program uses what this crate does not")]

#[cfg(target_arch = "nvptx64")]
extern crate alloc;
#[cfg(target_arch = "nvptx64")]
extern crate core as std;

mod bump;
#[cfg(target_arch = "nvptx64")]
mod device;
mod launch;
#[cfg(target_arch = "nvptx64")]
mod prelude;
mod run;

#[cfg(target_arch = "nvptx64")]
#[prelude_import]
use prelude::*;

pub use bump::Bump;
pub use launch::{Launch, rollouts};
pub use run::{Output, run};

#[path = "../../src/names.rs"]
mod names;

#[path = "../../src/task"]
mod task {
    pub mod constants;
    pub mod geometry;
}

#[path = "../../src/world"]
mod world {
    pub mod contact_criteria;
    pub mod effect;
    pub mod state;

    pub mod lanes {
        pub mod collision;
        pub mod contact_laws;
        pub mod contact_pair;
        pub mod continuous_collision;
        pub mod disc_separation;
        pub mod disc_solver;
        pub mod exchange;
        pub mod goal;
        pub mod gpu_format;
        pub mod kernel;
        pub mod manifold;
        pub mod manifold_solver;
        pub mod new_contact;
        pub mod outline;
        pub mod outline_separation;
        pub mod rest_detection;
        pub mod simd;
        pub mod sincos;
        pub mod state;
        pub mod topology;
        pub mod warm_start;
    }
}
