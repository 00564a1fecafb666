//! Rollouts per second of both engines on one core, on scenes read from a file of JSON lines:
//! `cargo bench --bench engines -- SCENES.jsonl [ENGINE ...]`, an engine being `rapier`, `lanes`, or `lanes:avx2`
//! (`baseline`, `avx2`, `avx512`). Writes a JSON line for each engine: medians and extremes over repetitions.
//!
//! Without a file it uses the bowling family's own scenes.

use std::time::Instant;

use iplw::task::{Placement, Scene, family};
use iplw::world::{Engine, Latents, Level, Rollout, Settings, simulate_map_set};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let scenes = match arguments.first() {
        Some(path) => read(path),
        None => bowling(200),
    };
    let engines =
        if arguments.len() > 1 { arguments[1..].to_vec() } else { vec!["lanes".into(), "rapier".into()] };
    // One thread: figures are per core.
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the pool is built once");
    for name in engines {
        measure(&name, &scenes);
    }
}

fn measure(name: &str, scenes: &[Scene]) {
    // `-full` steps through rest too: the kernel's own cost, where the other rows' us/step counts skipped steps.
    let (plain, end_at_rest) = match name.strip_suffix("-full") {
        Some(plain) => (plain, false),
        None => (name, true),
    };
    let (engine, level) = match plain.split_once(':') {
        Some((engine, level)) => (engine, level_named(level)),
        None => (plain, Level::best()),
    };
    let engine = Engine::from_name(engine).expect("an engine's name");
    let rollout = |scene| Rollout { scene, latents: Latents::default(), effects: &[], stop: false };
    let rollouts: Vec<Rollout> = scenes.iter().map(rollout).collect();
    let run = || {
        let settings = Settings { level, end_at_rest };
        simulate_map_set(settings, &rollouts, engine, |_, t| u64::from(t.outcome.steps))
            .expect("legal scenes")
    };
    let clock = Clock(Instant::now());
    run();
    // About half a second a repetition, at least one pass.
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
            "level": format!("{level:?}").to_lowercase(),
            "rollouts_per_s": count / seconds[3],
            "rollouts_per_s_range": [count / seconds[6], count / seconds[0]],
            "us_per_step": 1e6 * seconds[3] / steps as f64,
        })
    );
}

/// Seconds of processor time of all threads where Linux tells, so that other work on the machine counts less;
/// seconds on the wall elsewhere.
struct Clock(Instant);

impl Clock {
    fn seconds(&self) -> f64 {
        let own = |entry: std::io::Result<std::fs::DirEntry>| {
            let text = std::fs::read_to_string(entry.ok()?.path().join("schedstat")).ok()?;
            text.split(' ').next()?.parse::<f64>().ok()
        };
        match std::fs::read_dir("/proc/self/task") {
            Ok(threads) => threads.filter_map(own).sum::<f64>() / 1e9,
            Err(_) => self.0.elapsed().as_secs_f64(),
        }
    }
}

fn level_named(name: &str) -> Level {
    let level =
        Level::ALL.into_iter().find(|l| format!("{l:?}").to_lowercase() == name).expect("a level's name");
    assert!(level.available(), "this machine lacks {name}");
    level
}

fn read(path: &str) -> Vec<Scene> {
    let text = std::fs::read_to_string(path).expect("the file of scenes can be read");
    text.lines().map(|line| Scene::from_json(line).expect("a legal scene")).collect()
}

fn bowling(count: usize) -> Vec<Scene> {
    let scenes = (family("bowling").expect("built in").candidates)(0);
    let acted = |(i, scene): (usize, &Scene)| {
        let space = scene.action.as_ref()?;
        match space.place(scene, &space.at(i * 7919 % space.count()).ok()?) {
            Placement::Valid(placed) => Some(*placed),
            Placement::Invalid(_) => None,
        }
    };
    scenes.iter().enumerate().filter_map(acted).take(count).collect()
}
