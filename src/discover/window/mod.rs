//! Trials cut into windows, each simulated on its own from a start of its own.
//!
//! `kind`: what a window is. `cut`: a trial into windows. `flight`: of one body, its flights, bounces and rolls, by what
//! `touch` says of when it touches something and `hold` of when it is held; `whole`: of all bodies, where it is known where they start. `blocks`: averages of long ones.
//!
//! Source: multiple shooting (Bock, 1983), with starts taken as nuisances instead of being tied together: what happens
//! in a contact then cannot leak into what is said about the motion.

mod blocks;
mod cut;
mod flight;
mod hold;
mod kind;
mod touch;
mod whole;

pub use blocks::average;
pub use cut::cut;
pub use kind::{FLIGHT, Kind, Point, Surface, Window, known, leaping, shooting};
pub use whole::{launch, leave_runs};
