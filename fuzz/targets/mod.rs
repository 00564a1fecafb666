//! Everything that takes bytes from outside, and what must hold for any bytes: no panic, no end that does not come, no piece of
//! memory above 64 MiB. A row a target; `tests/fuzz/` runs all of them, libFuzzer (`fuzz_targets/`) one at a time.
//!
//! A target has seeds, a way to make mutants of them, and a check that panics where something is wrong.

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
pub use iplw::serve::fuzz::Fate;
use rand::RngExt;

/// What takes bytes from outside.
pub struct Target {
    pub name: &'static str,
    /// Executions with the tests; the first of those that a long run makes.
    pub short: u64,
    /// Executions of a long run.
    pub long: u64,
    /// Most memory asked for by an execution in all, bytes: a measure of its work that no machine's speed changes.
    pub work: u64,
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Changes a seed; the others are there to be mixed with.
    pub mutate: fn(&mut Vec<u8>, &[Vec<u8>], &mut Stream),
    pub check: fn(&[u8]) -> Fate,
}

/// Every target but scenes, which `tests/physics/fuzz_scene.rs` has.
pub const TARGETS: [Target; 11] = [
    zmtp::TARGET,
    msgpack::TARGET,
    requests::READ,
    requests::DONE,
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

/// Whether what reads text takes these bytes.
fn text(bytes: &[u8], read: impl FnOnce(&str) -> Fate) -> Fate {
    std::str::from_utf8(bytes).map_or(Fate::Refused, read)
}

/// What became of what was read; a refusal says what is allowed.
fn fate<T>(read: Result<T, iplw::error::Error>) -> Fate {
    match read {
        Ok(_) => Fate::Taken,
        Err(error) => {
            if let iplw::error::Error::Input(input) = &error {
                assert!(!input.allowed.is_empty(), "nothing is said to be allowed: {error}");
            }
            assert!(!error.to_string().is_empty());
            Fate::Refused
        }
    }
}
