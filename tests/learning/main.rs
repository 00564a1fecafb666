//! What is learned from trials: estimates, what the simulation lacks, files of trials.

#[path = "../discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

mod coverage;
mod discover;
mod estimate;
mod posterior;
mod recorded;
mod tracks;
mod trials;
