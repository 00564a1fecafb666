//! Parsers of external input, and the invariants for arbitrary bytes: no panic, termination, and no allocation above 64 MiB. One row
//! a target; `tests/fuzz/` runs all of them, libFuzzer (`fuzz_targets/`) one at a time.
//!
//! A target has seeds, a mutator, and a check that panics on a violation.

#[path = "../bytes.rs"]
pub mod bytes;
#[path = "../json.rs"]
pub mod json;

mod families;
mod files;
mod imports;
mod msgpack;
mod requests;
mod trials;
mod weights;
mod zmtp;

use iplw::rng::Stream;
pub use iplw::serve::fuzz::FuzzOutcome;
use rand::RngExt;

/// A fuzz target.
pub struct Target {
    pub name: &'static str,
    /// Executions in the test suite; the first ones of a long run.
    pub short: u64,
    /// Executions of a long run.
    pub long: u64,
    /// Maximum memory allocated by an execution in total, bytes: a machine-independent measure of work.
    pub work: u64,
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Mutates a seed; the other seeds may be spliced in.
    pub mutate: fn(&mut Vec<u8>, &[Vec<u8>], &mut Stream),
    pub check: fn(&[u8]) -> FuzzOutcome,
}

/// Every target except scenes, which `tests/physics/fuzz_scene.rs` covers.
pub const TARGETS: [Target; 11] = [
    zmtp::TARGET,
    msgpack::TARGET,
    requests::READ,
    requests::RUN,
    trials::OWN,
    trials::TRACKS,
    weights::TARGET,
    files::TOKENS,
    files::LIMITS,
    families::TARGET,
    imports::TARGET,
];

/// A mebibyte, bytes.
pub const MIB: u64 = 1 << 20;

/// The target with this name.
pub fn named(name: &str) -> &'static Target {
    TARGETS.iter().find(|t| t.name == name).expect("one of the targets")
}

/// A mutant of one of the seeds.
pub fn mutant(target: &Target, seeds: &[Vec<u8>], draw: &mut Stream) -> Vec<u8> {
    let mut bytes = seeds[draw.random_range(0..seeds.len())].clone();
    (target.mutate)(&mut bytes, seeds, draw);
    bytes
}

/// Runs a text parser on bytes.
fn text(bytes: &[u8], read: impl FnOnce(&str) -> FuzzOutcome) -> FuzzOutcome {
    std::str::from_utf8(bytes).map_or(FuzzOutcome::Rejected, read)
}

/// Outcome of a parser; an error must list the allowed values.
fn fate<T>(read: Result<T, iplw::error::Error>) -> FuzzOutcome {
    match read {
        Ok(_) => FuzzOutcome::Accepted,
        Err(error) => {
            if let iplw::error::Error::Input(input) = &error {
                assert!(!input.allowed.is_empty(), "nothing is said to be allowed: {error}");
            }
            assert!(!error.to_string().is_empty());
            FuzzOutcome::Rejected
        }
    }
}
