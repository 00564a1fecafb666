//! Learning from trials: estimation, diagnosis, posteriors and trial files.

#[path = "../discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with other test programs that use the rest")]
mod worlds;

mod coverage;
mod discover;
mod estimate;
mod posterior;
mod recorded;
mod tracks;
mod trials;
