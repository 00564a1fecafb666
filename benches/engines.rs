//! Rollouts per second of both engines on one core, on scenes read from a file of JSON lines:
//! `cargo bench --bench engines -- SCENES.jsonl [ENGINE ...]`, an engine being `rapier`, `lanes`, or `lanes:avx2`
//! (`baseline`, `avx2`, `avx512`). Writes a JSON line for each engine: medians and extremes over repetitions.
//!
//! Without a file it uses the bowling family's own scenes.

mod common;

use common::{Clock, level_name, rollouts, scenes};
use iplw::task::Scene;
use iplw::world::{BatchSettings, Engine, SimdLevel, Simulator};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let scenes = scenes(arguments.first());
    let engines =
        if arguments.len() > 1 { arguments[1..].to_vec() } else { vec!["lanes".into(), "rapier".into()] };
    // One thread: figures are per core.
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the pool is built once");
    for name in engines {
        measure(&name, &scenes);
    }
}

fn measure(name: &str, scenes: &[Scene]) {
    // `-full` also simulates steps at rest, which gives the kernel's own cost; the other rows' us/step counts skipped steps.
    let (plain, end_at_rest) = match name.strip_suffix("-full") {
        Some(plain) => (plain, false),
        None => (name, true),
    };
    let (engine, level) = match plain.split_once(':') {
        Some((engine, level)) => (engine, level_named(level)),
        None => (plain, SimdLevel::best()),
    };
    let engine = Engine::from_name(engine).expect("an engine's name");
    let rollouts = rollouts(scenes);
    let run = || {
        let settings = BatchSettings { level, end_at_rest };
        Simulator::new(engine)
            .settings(settings)
            .map(&rollouts, |_, t| u64::from(t.outcome.steps))
            .expect("legal scenes")
    };
    let clock = Clock::start();
    run();
    // About half a second per repetition, at least one pass.
    let passes = (0.5 / clock.seconds()).ceil().max(1.0) as usize;
    let mut seconds = Vec::new();
    let mut steps = 0;
    for _ in 0..7 {
        let start = clock.seconds();
        steps = (0..passes).map(|_| run().iter().sum::<u64>()).sum();
        seconds.push(clock.seconds() - start);
    }
    seconds.sort_by(f64::total_cmp);
    let count = (rollouts.len() * passes) as f64;
    println!(
        "{}",
        serde_json::json!({
            "engine": name,
            "level": level_name(level),
            "rollouts_per_s": count / seconds[3],
            "rollouts_per_s_range": [count / seconds[6], count / seconds[0]],
            "us_per_step": 1e6 * seconds[3] / steps as f64,
        })
    );
}

fn level_named(name: &str) -> SimdLevel {
    let level = SimdLevel::ALL.iter().copied().find(|l| level_name(*l) == name).expect("a level's name");
    assert!(level.available(), "this machine lacks {name}");
    level
}
