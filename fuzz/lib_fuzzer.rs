//! Adapter from a target to libFuzzer: inputs that reach new code are kept and mutated, by libFuzzer or by the target's mutator,
//! which also contributes its seeds.

#[path = "targets/mod.rs"]
#[allow(dead_code, reason = "the loop has more to know of a target")]
pub mod targets;

use std::sync::OnceLock;

use iplw::rng::stream;
use rand::RngExt;
use targets::Target;

macro_rules! target {
    ($name:literal) => {
        libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
            (lib_fuzzer::targets::named($name).check)(bytes);
        });

        libfuzzer_sys::fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
            lib_fuzzer::mutated(lib_fuzzer::targets::named($name), data, size, max_size, seed)
        });
    };
}
pub(crate) use target;

/// Mutates the first `size` bytes; returns the new size.
pub fn mutated(target: &Target, data: &mut [u8], size: usize, max_size: usize, seed: u32) -> usize {
    static SEEDS: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    if seed.is_multiple_of(2) {
        return libfuzzer_sys::fuzzer_mutate(data, size, max_size);
    }
    let (seeds, mut draw) = (SEEDS.get_or_init(target.seeds), stream(seed.into(), target.name));
    let mut bytes = data[..size].to_vec();
    if size < 2 || draw.random_range(0..16) == 0 {
        bytes = targets::mutant(target, seeds, &mut draw);
    } else {
        (target.mutate)(&mut bytes, seeds, &mut draw);
    }
    let length = bytes.len().min(max_size).min(data.len());
    data[..length].copy_from_slice(&bytes[..length]);
    length
}
