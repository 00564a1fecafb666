//! Trials cut into windows, each simulated on its own from a start of its own.
//!
//! `kind`: what a window is. `cut`: a trial into windows. `flight`: of one body, its flights, bounces and rolls, by what
//! `touch` says of when it touches something and `hold` of when it is held; `whole`: of all bodies, where it is known where they start.
//!
//! Source: multiple shooting (Bock, 1983), with starts taken as nuisances instead of being tied together: what happens
//! in a contact then cannot leak into what is said about the motion.

mod cut;
mod flight;
mod hold;
mod kind;
mod touch;
mod whole;

pub use cut::segment_trials;
pub use kind::{
    MIN_FLIGHT_OBSERVATIONS, Observation, Segment, SegmentKind, Surface, any_known_initial_state,
    any_multi_step, any_one_step,
};
pub use whole::{initial_state_guess, remove_overlaps};
