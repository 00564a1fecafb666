//! 95 % intervals cover the truth about 95 times in 100, for hidden worlds with random latents, noise and an
//! otherwise correct simulation. `examples/coverage.rs` is the long version. Seeds are fixed, so the test is
//! deterministic.

use crate::cases;
use iplw::experiment::{EstimateConfig, ResidualKind, estimate};
use iplw::progress::NoProgress;
use iplw::reality::{HiddenConfig, HiddenWorld, standard};
use iplw::rng;
use iplw::task::{Split, family, split};
use iplw::world::Latents;
use rand::RngExt;

/// Errors of friction and restitution in units of the interval's half width, over `count` worlds.
fn errors(name: &str, residual: ResidualKind, count: u64) -> Vec<f64> {
    let family = family(name).unwrap();
    let tasks = split(&family.tasks(), Split::Train);
    let mut all = Vec::new();
    for seed in 0..count {
        let mut stream = rng::stream(seed, "truth");
        let mut between = |low: f64, high: f64| low + (high - low) * stream.random::<f64>();
        let truth = [between(0.2, 2.0), between(0.1, 0.5), between(0.2, 0.9)];
        let hidden = HiddenConfig {
            latents: Latents::of(truth),
            effects: Vec::new(),
            noise: 0.02,
            seed,
            ..standard(family)
        };
        let config = EstimateConfig {
            rounds: 1,
            candidates: 60,
            residual,
            seed,
            ..EstimateConfig::fast(family.prior)
        };
        let (report, _) =
            estimate(&tasks, &mut HiddenWorld::new(hidden).unwrap(), &config, &NoProgress).unwrap();
        assert!(!report.latents[0].identifiable, "density cancels: {:?}", report.latents[0]);
        for (found, truth) in report.latents.iter().zip(truth).skip(1) {
            if let [Some(low), Some(high)] = found.ci95 {
                all.push((found.value - truth).abs() / ((high - low) / 2.0));
            }
        }
    }
    all
}

fn check(name: &str, residual: ResidualKind, count: u64) {
    let errors = errors(name, residual, count);
    let within =
        |half_widths: f64| errors.iter().filter(|e| **e <= half_widths).count() as f64 / errors.len() as f64;
    let told = errors.len() as f64 / (2 * count) as f64;
    assert!(told > 0.6, "{name}: only {told} of the latents are identified");
    assert!(within(1.0) >= 0.9, "{name}: intervals cover {} of the truths", within(1.0));
    assert!(within(0.5) < 0.9, "{name}: intervals of half the width would cover {}: too wide", within(0.5));
}

#[test]
fn intervals_cover_the_truth_in_basketball() {
    check("basketball", ResidualKind::Trajectory, cases(20, 60) as u64);
}

/// Positions from a camera without velocities: every segment's initial state is fitted.
#[test]
fn intervals_cover_the_truth_in_basketball_with_shooting() {
    check("basketball", ResidualKind::Shooting, cases(8, 30) as u64);
}
