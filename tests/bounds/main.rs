//! Bounds of requests: peak memory against its estimate, and processor time between two checks of the budget.

mod memory;
mod recordings;
mod scenes;
mod stopwatch;

use std::time::Instant;

use iplw::inference::posterior::{PosteriorConfig, TrialLikelihood, posterior};
use iplw::inference::{DiagnosisConfig, diagnose};
use stopwatch::Stopwatch;

/// Prints processor times between checks and peak memory of large inputs: `cargo test --test bounds -- --ignored --nocapture`.
#[test]
#[ignore = "takes minutes; prints figures"]
fn figures() {
    let env = |name: &str, default: usize| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default);
    let (count, frames, bodies) = (env("TRIALS", 50), env("FRAMES", 500), env("BODIES", 1));
    let what = std::env::var("WHAT").unwrap_or("diagnosis".into());
    let (scene, trials) = recordings::throws(count, frames, bodies);
    let watch = Stopwatch::new();
    let start = Instant::now();
    let (result, peak) = memory::peak_of(|| match what.as_str() {
        "diagnosis" => diagnose(&scene, &trials, &DiagnosisConfig::standard(0), &watch).map(drop),
        "posterior" => posterior(&scene, &trials, &PosteriorConfig { sets: vec![vec!["linear_drag".into()]], ..PosteriorConfig::standard(0) }, &watch).map(drop),
        _ => TrialLikelihood::new(&scene, &trials, &PosteriorConfig { sets: vec![vec!["linear_drag".into()]], ..PosteriorConfig::standard(0) }, &watch).map(drop),
    });
    println!("{what} {count} x {frames} x {bodies}: {:?}, {:.1} s, peak {} MB", result.err(), start.elapsed().as_secs_f64(), peak / 1_000_000);
    for (seconds, stage, trace) in watch.longest() {
        println!("  {seconds:.3} s up to a check in stage {stage:?}\n{trace}");
    }
}

/// Prints the time of a step of scenes of several sizes by engine.
#[test]
#[ignore = "prints figures"]
fn step_times() {
    use iplw::world::{Engine, Rollout, Simulator, select_engine};
    for (bodies, statics, spacing) in [
        ([1, 1, 1], [1, 1, 4], 2.0),
        ([3, 1, 1], [5, 1, 4], 2.0),
        ([3, 1, 4], [5, 1, 4], 2.0),
        ([6, 1, 4], [10, 1, 4], 2.0),
        ([64, 1, 1], [1, 1, 4], 2.0),
        ([64, 1, 1], [256, 1, 4], 2.0),
        ([64, 1, 4], [64, 1, 4], 2.0),
        ([64, 1, 4], [256, 1, 4], 2.0),
        ([64, 1, 1], [0, 1, 4], 0.9),
        ([64, 1, 1], [0, 1, 4], 0.0),
        ([64, 1, 4], [0, 1, 4], 0.9),
        ([64, 1, 4], [0, 1, 4], 0.0),
        ([2, 32, 4], [0, 1, 4], 0.9),
        ([2, 32, 1], [0, 1, 4], 0.9),
        ([2, 32, 32], [0, 1, 4], 0.9),
        ([8, 32, 4], [8, 32, 4], 0.9),
        ([64, 32, 1], [0, 1, 1], 0.9),
        ([64, 32, 1], [64, 32, 1], 2.0),
        ([64, 32, 1], [64, 32, 1], 0.9),
        ([1, 32, 1], [126, 32, 1], 0.0),
        ([4, 1, 32], [100, 1, 32], 0.0),
    ] {
        for engine in [Engine::Rapier, Engine::Lanes] {
            let scene = scenes::row(bodies, statics, spacing);
            let rollout = Rollout::of(&scene);
            if select_engine(engine, &rollout).is_err() {
                continue;
            }
            let one = |steps: u32| {
                let scene = iplw::task::Scene { steps, ..scene.clone() };
                let start = Instant::now();
                Simulator::new(engine).one(Rollout::of(&scene)).map(drop).ok();
                start.elapsed().as_secs_f64()
            };
            let (few, many) = (one(1), one(11));
            let cost = scene.step_cost();
            let step = (many - few) / 10.0 * 1e6;
            println!("{engine:?} {bodies:?} {statics:?} {spacing}: first {:.0} us, then {step:.1} us a step, cost {cost}, {:.3} us per cost", few * 1e6, step / cost as f64);
            if step > 3e5 { return; }
        }
    }
}
