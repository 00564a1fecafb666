//! Token files and limits files: JSON.

use iplw::access::{parse_token_file, parse_token_rows};
use iplw::rng::Stream;
use iplw::serve::fuzz::limits;
use rand::RngExt;

use super::{FuzzOutcome, MIB, Target, fate, json, text};

/// A token file, and its rows alone, as in the environment variable.
pub const TOKENS: Target = Target {
    name: "tokens",
    short: 5_000,
    long: 10_000_000,
    work: 16 * MIB,
    seeds: || vec![TOKEN_FILE.into(), TOKEN_ROWS.into()],
    mutate,
    check: |bytes| text(bytes, tokens),
};

/// A file of limits.
pub const LIMITS: Target = Target {
    name: "limits",
    short: 5_000,
    long: 10_000_000,
    work: 16 * MIB,
    seeds: || vec![LIMITS_FILE.into(), b"{}".to_vec()],
    mutate,
    check: |bytes| text(bytes, limits),
};

const TOKEN_FILE: &str = r#"{"format": "iplw.tokens/1", "tokens": [
    {"name": "ann", "may": "act", "sha256": "2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824",
     "made": "2026-11-25T00:00:00Z", "expires": "2027-02-28T23:59:59Z"},
    {"name": "eve", "may": "read", "sha256": "0000000000000000000000000000000000000000000000000000000000000000"}]}"#;

const TOKEN_ROWS: &str = r#"[{"name": "ci", "may": "admin",
    "sha256": "ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff", "expires": "2026-12-31T00:00:00Z"}]"#;

const LIMITS_FILE: &str = r#"{"request_seconds": 5, "header_seconds": 1.5, "body_seconds": 60, "idle_seconds": 120,
    "write_seconds": 60, "connections": 200, "body_steps": 1000000, "actions": 64, "samples": 100000, "worlds": 8,
    "world_idle_seconds": 60, "jobs_running": 1, "jobs_waiting": 4, "job_seconds": null}"#;

/// Mutates a document's fields, and strings character by character.
fn mutate(seed: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Stream) {
    match serde_json::from_slice(seed) {
        Ok(value) if draw.random_range(0..3) > 0 => *seed = json::mutant(value, draw),
        _ => super::bytes::mutate(seed, seeds, &WORDS, draw),
    }
}

const WORDS: [&[u8]; 10] =
    [b"9", b"-", b"T", b"Z", b"+01:00", b"e308", b"\"", b"2024-02-29", b"99999-12-31T24:00:60Z", b"\\u0000"];

fn tokens(text: &str) -> FuzzOutcome {
    let as_rows = fate(parse_token_rows(text, "rows"));
    let read = parse_token_file(text, "tokens.json");
    for token in read.iter().flatten() {
        assert_eq!(token.digest.hex().len(), 64);
        assert!(!token.name.is_empty() && !token.name.contains(' '), "{:?}", token.name);
    }
    if fate(read) == FuzzOutcome::Accepted { FuzzOutcome::Accepted } else { as_rows }
}
