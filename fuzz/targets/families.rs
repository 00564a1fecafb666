//! Task family files: TOML with expressions.

use iplw::rng::Stream;
use iplw::task::parse_family;

use super::{MIB, Target, bytes, fate, text};

/// A family file.
pub const TARGET: Target = Target {
    name: "families",
    short: 500,
    long: 1_000_000,
    work: 256 * MIB,
    seeds: || SEEDS.map(|s| s.as_bytes().to_vec()).into(),
    mutate,
    check: |bytes| text(bytes, |text| fate(parse_family(text))),
};

const SEEDS: [&str; 4] = [
    include_str!("../../examples/families/bank.toml"),
    include_str!("../../examples/families/shelf.toml"),
    include_str!("../../examples/families/topple.toml"),
    include_str!("../../src/task/families/basketball.toml"),
];

fn mutate(seed: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Stream) {
    bytes::mutate(seed, seeds, &WORDS, draw);
}

const WORDS: [&[u8]; 16] = [
    b"1e308",
    b"-0.0",
    b"nan",
    b"inf",
    b"\"= ",
    b"sqrt(",
    b"min(",
    b" / 0",
    b" and ",
    b"not ",
    b"{ low = 0, high = 1 }",
    b"{ from = 0, to = 1e9, step = 1e-9 }",
    b"[[",
    b"]",
    b"2026-01-01",
    b"99999999",
];
