//! Fuzzing of scenes on stable Rust: valid scenes are mutated, and every mutant must be rejected by name or
//! simulated to finite numbers in both engines (`fuzz/fuzz_one.rs`).
//!
//! By default ten thousand mutants of fixed seeds. `FUZZ_SCENES=1000000 cargo test --release --test physics
//! fuzz_scene` runs that many, `FUZZ_SEED=17` starts at another seed; a failure prints the seed and the
//! mutant.

use crate::fuzz_one::{Fate, fuzz_one};
use crate::json;
use iplw::rng::stream;
use iplw::task::{Placement, Scene, families};
use iplw::world::effect;
use rand::RngExt;
use rayon::iter::Either;
use rayon::prelude::*;
use serde_json::{Map, Value, json};

/// Default number of mutants: some seconds.
const MUTANTS: u64 = 10_000;

#[test]
fn mutated_scenes_are_rejected_by_name_or_simulated() {
    let number = |name: &str| std::env::var(name).ok().and_then(|v| v.parse::<u64>().ok());
    let (first, count) = (number("FUZZ_SEED").unwrap_or(0), number("FUZZ_SCENES").unwrap_or(MUTANTS));
    let seeds = seeds();
    let (fates, failures): (Vec<Fate>, Vec<String>) =
        (first..first + count).into_par_iter().partition_map(|seed| {
            let bytes = mutant(&seeds, seed);
            match std::panic::catch_unwind(|| fuzz_one(&bytes)) {
                Ok(fate) => Either::Left(fate),
                Err(panic) => {
                    let said = panic.downcast_ref::<String>().map_or("a panic", |s| s);
                    Either::Right(format!("seed {seed}: {said}\n    {}", String::from_utf8_lossy(&bytes)))
                }
            }
        });
    let shown: Vec<String> = failures.iter().take(10).map(|f| f.chars().take(3000).collect()).collect();
    assert!(failures.is_empty(), "{} failures:\n{}", failures.len(), shown.join("\n"));
    let share = |fate| fates.iter().filter(|f| **f == fate).count() as f64 / fates.len() as f64;
    let (refused, simulated) = (share(Fate::Refused), share(Fate::Simulated));
    println!("{count} mutants: {:.1} % refused, {:.1} % simulated", 100.0 * refused, 100.0 * simulated);
    assert!(refused > 0.2 && simulated > 0.15, "too few mutants are rejected or simulated");
}

#[test]
fn seeds_are_valid_and_simulated() {
    for (i, seed) in seeds().iter().enumerate() {
        let fate = fuzz_one(seed.to_string().as_bytes());
        assert_eq!(fate, Fate::Simulated, "seed {i}: {:?}", Scene::from_json(&seed.to_string()).err());
    }
}

/// Regression: values that led to a division by zero, or to a shape without interior.
#[test]
fn rejects_degenerate_shapes() {
    let star: Vec<[f64; 2]> =
        (0..5).map(|k| (1.2566 * 2.0 * f64::from(k)).sin_cos()).map(|(y, x)| [x, y]).collect();
    let shapes = [
        json!({"type": "polygon", "vertices": star}),
        json!({"type": "disc", "radius": 1e-300}),
        json!({"type": "box", "half_width": 1.0, "half_height": 1e-200}),
        json!({"type": "segment", "from": [0, 0], "to": [1e-200, 0]}),
    ];
    for shape in shapes {
        let mut scene = seeds().pop().expect("there are seeds");
        scene["statics"][0]["shape"] = shape;
        let error = Scene::from_json(&scene.to_string()).expect_err("it is refused").to_string();
        assert!(error.starts_with("`statics[0].shape."), "{error}");
    }
    for (field, value) in [("mass", 1e-300), ("density", 1e-300)] {
        let mut scene = seeds().pop().expect("there are seeds");
        scene["bodies"][2][field] = json!(value);
        let error = Scene::from_json(&scene.to_string()).expect_err("it is refused").to_string();
        assert!(error.starts_with(&format!("`bodies[2].{field}`")), "{error}");
    }
}

/// Valid scenes that together use every field, every shape and every effect.
fn seeds() -> Vec<Value> {
    let mut seeds = Vec::new();
    for family in families() {
        let scene = family.candidates(0).next().unwrap();
        let space = scene.action.as_ref().expect("it has one");
        let placed = (0..).find_map(|k| match space.place(&scene, &space.at(k).expect("it exists")) {
            Placement::Valid(placed) => Some(placed),
            Placement::Invalid(_) => None,
        });
        seeds.extend([&scene, &*placed.expect("some action can be placed")].map(|s| json!(s)));
    }
    // The families' scenes need an action before a rollout: only placed ones are seeds.
    seeds.retain(|s| s["bodies"].as_array().is_some_and(|b| b.iter().all(|b| !b["position"].is_null())));
    seeds.push(json!({
        "format": "iplw.scene/1", "name": "all shapes", "gravity": [0.5, -9.81],
        "bodies": [
            {"name": "disc", "shape": {"type": "disc", "radius": 0.02}, "mass": 0.0027, "friction": 0.3,
             "restitution": 0.9, "position": [0, 0.3], "angle": 0.1, "velocity": [3, 1], "angular_velocity": 5},
            {"name": "box", "shape": {"type": "box", "half_width": 0.5, "half_height": 0.2}, "density": 2.0,
             "position": [2, 1], "velocity": [-3, 0]},
            {"name": "polygon", "shape": {"type": "polygon", "vertices": [[0, 0], [1, 0], [0.6, 0.9]]},
             "position": [4, 1], "angular_velocity": -3},
            {"name": "bar", "shape": {"type": "segment", "from": [-0.4, 0], "to": [0.4, 0.1], "radius": 0.1},
             "position": [6, 1]}
        ],
        "statics": [
            {"name": "table", "shape": {"type": "segment", "from": [-5, 0], "to": [1, 0], "radius": 0.0}},
            {"name": "ground", "shape": {"type": "halfspace", "normal": [0, 1], "offset": -0.5}, "friction": 0.7},
            {"name": "ramp", "shape": {"type": "polygon", "vertices": [[0, 0], [3, 0], [3, 0.3]]},
             "position": [4, 0], "angle": 0.05, "restitution": 0.4},
            {"name": "post", "shape": {"type": "disc", "radius": 0.1}, "position": [1.5, 0.2]},
            {"name": "wall", "shape": {"type": "box", "half_width": 0.1, "half_height": 2}, "position": [9, 1]}
        ],
        "effects": [{"name": "linear_drag", "parameters": {"c": 0.3}}],
        "damping": 0.9, "time_step": 0.004, "steps": 50, "observe_every": 7,
        "goal": {"type": "inside", "body": "disc", "region": [[0, 0], [3, 0], [3, 3]], "hold_s": 0.02},
        "calibrate": ["restitution"], "per_setting": ["lift"], "carriers": ["disc", "table"],
        "settings": {"slow": {"bodies": {"disc": {"mass": 0.003}}, "statics": {"post": {"position": [1.5, 0.1]}}}}
    }));
    seeds.push(json!({
        "format": "iplw.scene/1", "name": "discs",
        "bodies": [
            {"name": "a", "shape": {"type": "disc", "radius": 0.5}, "mass": 1.0, "friction": 0.3,
             "restitution": 1.0, "position": [0, 0.6], "angle": 0.1, "velocity": [3, -100], "angular_velocity": 50},
            {"name": "b", "shape": {"type": "disc", "radius": 0.3}, "density": 2.0, "position": [1, 0.4],
             "velocity": [-30, 0]},
            {"name": "c", "shape": {"type": "disc", "radius": 0.1}, "position": [0.1, 1.3]}
        ],
        "statics": [
            {"name": "table", "shape": {"type": "segment", "from": [-5, 0], "to": [5, 0], "radius": 0.05}},
            {"name": "ground", "shape": {"type": "halfspace", "normal": [0.6, 0.8], "offset": -5}},
            {"name": "ramp", "shape": {"type": "polygon", "vertices": [[0, 0], [3, 0], [3, 0.3]]},
             "position": [2, 0], "angle": 0.05},
            {"name": "post", "shape": {"type": "disc", "radius": 0.1}, "position": [-1.5, 0.2]}
        ],
        "time_step": 0.01, "steps": 60, "observe_every": 1, "stop": false,
        "goal": {"type": "contact", "bodies": ["a", "table"], "hold_s": 0.1, "tolerance": 0.01}
    }));
    // Every effect, at a tenth of the distance from its neutral values to its upper bounds.
    for effect in effect::REGISTRY {
        let mut scene = seeds.last().expect("there are seeds").clone();
        let value = |p: &effect::ParameterDeclaration| json!(p.neutral + 0.1 * (p.bounds[1] - p.neutral));
        let parameters: Map<String, Value> =
            effect.parameters.iter().map(|p| (p.name.to_string(), value(p))).collect();
        scene["effects"] = json!([{"name": effect.name, "parameters": parameters}]);
        seeds.push(scene);
    }
    seeds
}

/// The mutant of a seed.
fn mutant(seeds: &[Value], seed: u64) -> Vec<u8> {
    let mut draw = stream(seed, "fuzz");
    let scene = seeds[draw.random_range(0..seeds.len())].clone();
    json::mutant(scene, &mut draw)
}
