//! Weights: safetensors with a model card.

use std::sync::LazyLock;

use iplw::policy::{Dqn, Policy, TrainConfig};
use iplw::rng::Stream;
use iplw::task::{Learning, families};
use rand::RngExt;

use super::{FuzzOutcome, MIB, Target, bytes, fate};

pub const TARGET: Target = Target {
    name: "weights",
    short: 5_000,
    long: 10_000_000,
    work: 16 * MIB,
    seeds: || vec![SEED.clone()],
    mutate,
    check,
};

/// A small untrained network with a card that claims training.
static SEED: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let task = families()[0].tasks().swap_remove(0);
    let dqn = Dqn::untrained(&task, 2, 1).expect("a small network");
    let config = TrainConfig { hidden: 2, ..TrainConfig::preset(&Learning::STANDARD) };
    let config = serde_json::to_string(&config).expect("plain fields").replace('"', r#"\""#);
    let bytes = dqn.to_safetensors().expect("it has weights");
    with_header(&bytes, |text| {
        let text = String::from_utf8(text).expect("JSON");
        let mut text = text.trim_end().replace(r#"trained\":[]"#, &format!(r#"trained\":[{config}]"#));
        text += &" ".repeat(text.len().next_multiple_of(8) - text.len());
        text.into_bytes()
    })
});

/// The same tensors under another header.
fn with_header(bytes: &[u8], change: impl FnOnce(Vec<u8>) -> Vec<u8>) -> Vec<u8> {
    let length = bytes.first_chunk().map_or(0, |n| u64::from_le_bytes(*n) as usize);
    let from = length.saturating_add(8).min(bytes.len());
    let header = change(bytes[8.min(from)..from].to_vec());
    [&(header.len() as u64).to_le_bytes()[..], &header, &bytes[from..]].concat()
}

fn mutate(seed: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Stream) {
    // The header has the complexity; the numbers follow it.
    if draw.random_range(0..8) == 0 {
        return bytes::mutate(seed, seeds, &WORDS, draw);
    }
    *seed = with_header(seed, |mut text| {
        bytes::mutate(&mut text, seeds, &WORDS, draw);
        text
    });
}

const WORDS: [&[u8]; 18] = [
    b"\"",
    b"\\\"",
    b"{",
    b"}",
    b"[",
    b"]",
    b",",
    b":",
    b"0",
    b"9",
    b"99999999999",
    b"-1",
    b"1e99",
    b"\"F32\"",
    b"\"F64\"",
    b"\"BF16\"",
    b"\"data_offsets\":[0,8]",
    b"\"shape\":[18446744073709551615,2]",
];

/// Accepted weights survive a round trip.
fn check(bytes: &[u8]) -> FuzzOutcome {
    let read = Dqn::from_safetensors(bytes);
    if let Ok(dqn) = &read {
        let written = dqn.to_safetensors().expect("it has weights");
        assert_eq!(Dqn::from_safetensors(&written).expect("it was just written"), *dqn);
    }
    fate(read)
}
