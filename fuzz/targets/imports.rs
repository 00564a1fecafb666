//! Imported tasks: PHYRE's JSON, and lists of scenes.

use iplw::rng::Stream;
use iplw::task::{parse_family_beside, phyre};
use rand::RngExt;
use serde_json::Value;

use super::{FuzzOutcome, MIB, Target, bytes, fate, json, text};

/// Either kind of file.
pub const TARGET: Target = Target {
    name: "imports",
    short: 500,
    long: 1_000_000,
    work: 64 * MIB,
    seeds: || SEEDS.map(|s| s.as_bytes().to_vec()).into(),
    mutate,
    check: |bytes| text(bytes, read),
};

fn read(text: &str) -> FuzzOutcome {
    let of_phyre = phyre::PhyreTasks::from_json(text).map(|tasks| {
        let result = |template: &&str| {
            tasks.scenes(template).into_iter().all(|(_, result)| fate(result) == FuzzOutcome::Accepted)
        };
        tasks.templates().iter().all(result)
    });
    match of_phyre {
        Ok(true) => FuzzOutcome::Accepted,
        Ok(false) => FuzzOutcome::Rejected,
        Err(_) => fate(parse_family_beside(FAMILY, &|_| Ok(text.into()))),
    }
}

fn mutate(seed: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Stream) {
    match serde_json::from_slice::<Value>(seed) {
        Ok(value) if draw.random_range(0..8) > 0 => *seed = json::mutant(value, draw),
        _ => bytes::mutate(seed, seeds, &[b"\n", b"1e308", b"null", b"[[", b"\"circle\""], draw),
    }
}

const FAMILY: &str = r#"
format = "iplw.family/1"
name = "listed"
about = "scenes of a list"
candidates = { scenes = "listed.jsonl" }
real = { density = 1, friction = 0.5, restitution = 0.5, damping = 1 }
tasks = { train = 1, validation = 0, test = 0, sample = 10, bins = [{ from = 0, to = 1, tasks = 1 }] }
"#;

const SEEDS: [&str; 2] = [
    r#"{"00000:003": {"tier": "BALL", "phantom": false, "bodies": [
        {"x": 128, "y": -2.5, "angle": 0.0, "dynamic": false, "kind": null,
         "shapes": [{"polygon": [[128, 2.5], [-128, 2.5], [-128, -2.5], [128, -2.5]]}]},
        {"x": 60, "y": 12, "angle": 0.5, "dynamic": true, "kind": "ball", "shapes": [{"circle": 12}]},
        {"x": 120, "y": 12, "angle": 0.0, "dynamic": true, "kind": "jar", "shapes": [
          {"polygon": [[-12, -12], [12, -12], [12, -6], [-12, -6]]},
          {"polygon": [[-12, -6], [-6, -6], [-6, 12], [-12, 12]]}]}],
        "goal": {"relation": ["touching"], "body1": 1, "body2": 2},
        "solutions": [[0.5, 0.25, 0.51]], "random_actions": {"-1": 1}}}"#,
    r#"{"solutions": [[0.5, 0.25]], "scene": {"format": "iplw.scene/1", "bodies": [{"name": "red", "shape": {"type": "disc", "radius": 0.5}}], "statics": [{"name": "floor", "shape": {"type": "box", "half_width": 5, "half_height": 0.5}}], "goal": {"type": "apart", "bodies": ["red", "floor"], "after_touch": true, "hold_s": 0.5}, "action": {"components": [{"target": "red", "set": "x", "low": -5, "high": 5}, {"target": "red", "set": "y", "low": 2, "high": 5}]}}}"#,
];
