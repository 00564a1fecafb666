//! Bounds of requests: validation time of the largest scenes, estimates of peak memory, and checks of the budget.

mod cancellation;
mod memory;
mod recordings;
mod scenes;
mod stopwatch;

use std::time::Instant;

use iplw::budget::Unlimited;
use iplw::error::Error;
use iplw::inference::memory as estimates;
use iplw::progress::NoProgress;
use iplw::reality::read_trials_csv;
use iplw::task::complexity::{MAX_CORNERS, MAX_SETTING_CORNERS};
use iplw::task::scene::{BodyOverride, Setting};

use iplw::inference::posterior::{PosteriorConfig, TrialLikelihood, posterior};
use iplw::inference::{DiagnosisConfig, diagnose};
use stopwatch::Stopwatch;

/// Prints processor times between checks and peak memory of large inputs: `cargo test --test bounds -- --ignored --nocapture`.
#[test]
#[ignore = "takes minutes; prints figures"]
fn figures() {
    let _alone = memory::alone();
    let env =
        |name: &str, default: usize| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default);
    let (count, frames, bodies) = (env("TRIALS", 50), env("FRAMES", 500), env("BODIES", 1));
    let what = std::env::var("WHAT").unwrap_or("diagnosis".into());
    let (scene, trials) = recordings::throws(count, frames, bodies);
    let watch = Stopwatch::new();
    let start = Instant::now();
    let (result, peak) = memory::peak_of(|| match what.as_str() {
        "diagnosis" => diagnose(&scene, &trials, &DiagnosisConfig::standard(0), &watch).map(drop),
        "posterior" => posterior(
            &scene,
            &trials,
            &PosteriorConfig { sets: vec![vec!["linear_drag".into()]], ..PosteriorConfig::standard(0) },
            &watch,
        )
        .map(drop),
        _ => TrialLikelihood::new(
            &scene,
            &trials,
            &PosteriorConfig { sets: vec![vec!["linear_drag".into()]], ..PosteriorConfig::standard(0) },
            &watch,
        )
        .map(drop),
    });
    println!(
        "{what} {count} x {frames} x {bodies}: {:?}, {:.1} s, peak {} MB",
        result.err(),
        start.elapsed().as_secs_f64(),
        peak / 1_000_000
    );
    for (seconds, stage, trace) in watch.longest() {
        println!("  {seconds:.3} s up to a check in stage {stage:?}\n{trace}");
    }
}

/// Prints the time of a step of scenes of several sizes by engine.
#[test]
#[ignore = "prints figures"]
fn step_times() {
    let _alone = memory::alone();
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
            println!(
                "{engine:?} {bodies:?} {statics:?} {spacing}: first {:.0} us, then {step:.1} us a step, cost {cost}, {:.3} us per cost",
                few * 1e6,
                step / cost as f64
            );
            if step > 3e5 {
                return;
            }
        }
    }
}

/// The most expensive scenes that are allowed are valid (in 0.1 s, which is printed), and the next larger ones are refused. Regression: 800
/// settings of 2880 polygons took 73 s.
#[test]
fn scenes_are_valid_up_to_the_limits() {
    let _alone = memory::alone();
    let timed = |scene: &iplw::task::Scene| {
        let start = Instant::now();
        (scene.validate(), start.elapsed().as_secs_f64())
    };
    // Touching rows of bodies: every pair of corners is visited.
    let full = scenes::row([2, 32, 32], [2, 32, 32], 1.0);
    let mut settings = scenes::row([1, 32, 32], [0, 1, 1], 1.0);
    let moved = Setting {
        bodies: [("b0".to_string(), BodyOverride { angle: Some(0.1), ..BodyOverride::default() })].into(),
        ..Setting::default()
    };
    let count = MAX_SETTING_CORNERS / (1024 + 16);
    settings.settings = (0..count).map(|k| (format!("s{k}"), moved.clone())).collect();
    for scene in [&full, &settings] {
        assert!(scene.corner_count() <= MAX_CORNERS);
        let (valid, seconds) = timed(scene);
        valid.unwrap();
        println!("{} corners, {} settings: {seconds:.3} s", scene.corner_count(), scene.settings.len());
    }
    settings.settings.insert("one more".into(), moved);
    let large = scenes::row([4, 32, 32], [1, 1, 1], 2.0);
    for (scene, field) in [(&settings, "settings"), (&large, "bodies")] {
        let text = scene.validate().unwrap_err().to_string();
        assert!(text.contains(&format!("`{field}` is")) && text.contains("at most"), "{text}");
    }
}

/// The estimate of peak memory is between the measured peak and three times it. Regression: a posterior of 10 MB of trials took 5.5 GB.
#[test]
fn estimates_of_memory_bound_the_peaks() {
    let _alone = memory::alone();
    for (count, frames) in [(12, 40), (24, 40), (12, 400)] {
        let (scene, trials) = recordings::throws(count, frames, 1);
        let config =
            PosteriorConfig { sets: vec![vec!["linear_drag".into()]], ..PosteriorConfig::standard(0) };
        let peaks = [
            memory::peak_of(|| {
                diagnose(&scene, &trials, &DiagnosisConfig::standard(0), &NoProgress).map(drop)
            }),
            memory::peak_of(|| TrialLikelihood::new(&scene, &trials, &config, &NoProgress).map(drop)),
        ];
        let estimates =
            [estimates::diagnosis, estimates::posterior].map(|of| of(&scene, &trials, &NoProgress));
        for ((result, peak), estimate) in peaks.into_iter().zip(estimates) {
            result.unwrap();
            let ratio = estimate.unwrap() as f64 / peak as f64;
            println!("{count} x {frames}: peak {:.1} MB, estimate {ratio:.2} times that", peak as f64 / 1e6);
            assert!((1.0..3.0).contains(&ratio), "{ratio}");
        }
    }
}

/// Files of too many cells are refused before they are parsed. Regression: 10^7 rows took 9 GB.
#[test]
fn large_files_of_trials_are_refused() {
    let _alone = memory::alone();
    let scene = recordings::throws(1, 3, 1).0;
    let text = format!("trial,t,body,x,y\n{}", "a,0.001,ball0,0.01,0.02\n".repeat(500_000));
    let (read, peak) = memory::peak_of(|| read_trials_csv(&text, &scene, &Unlimited));
    assert!(matches!(read, Err(Error::TooLarge { .. })) && peak < 1_000_000, "{peak} bytes");
}
