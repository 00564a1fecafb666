//! Synthetic recordings have the properties that their generator documents.

use crate::worlds::camera;
use crate::worlds::law::{Law, Motion};
use crate::worlds::recorded::{self, Kind, World};

fn spread(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let all: Vec<f64> = values.collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    (mean, (all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (all.len() - 1) as f64).sqrt())
}

fn points(world: &World) -> impl Iterator<Item = (f64, f64)> {
    let tracks = |i: usize| {
        let (seen, clean) = (&world.trials[i].observed.bodies[0], &world.clean[i].observed.bodies[0]);
        seen.x.iter().zip(&clean.x).map(|(a, b)| (*a, *b)).collect::<Vec<_>>()
    };
    (0..world.trials.len()).flat_map(tracks)
}

#[test]
fn recorded_worlds_repeat_by_seed() {
    for kind in [Kind::Single(1), Kind::Contact(0), Kind::Contact(4)] {
        let csv = |seed| iplw::reality::trials_to_csv(&recorded::of_kind(kind, true, seed).trials);
        assert_eq!(csv(3), csv(3), "{kind:?}");
        assert_ne!(csv(3), csv(4), "{kind:?}");
    }
}

/// Every kind of world is generated; its effect shifts paths by 5 to 20 standard deviations and is not hidden
/// by between-trial variation.
#[test]
fn recorded_effects_have_documented_strength() {
    let kinds = recorded::kinds();
    for (i, kind) in kinds.iter().enumerate() {
        let world = recorded::world(i as u64, 11, false);
        assert!((14..=80).contains(&world.trials.len()) && world.trials.len() == world.clean.len());
        assert!((5e-4..=3e-3).contains(&world.noise), "{kind:?}: {}", world.noise);
        match kind {
            Kind::Nothing(_) => assert!(world.right.is_empty() && world.shift == 0.0),
            Kind::Spin => assert!(world.sizes[0].value > 0.12 && world.sizes[0].value < 0.18),
            _ => {
                assert!(world.shift > 4.5 && world.shift < 20.5, "{kind:?}: {} deviations", world.shift);
                assert!(world.margin > 1.5, "{kind:?}: {}", world.margin);
                assert!(world.sizes.iter().all(|s| s.value.is_finite()));
            }
        }
    }
}

/// Between-trial variation of effect sizes, lifts and camera tilt.
#[test]
fn recorded_trials_vary_as_documented() {
    let worlds: Vec<World> = (0..6).map(|seed| recorded::of_kind(Kind::Single(1), true, seed)).collect();
    let laws = || worlds.iter().flat_map(|w| &w.laws);
    let sizes = worlds.iter().flat_map(|w| {
        let (mean, _) = spread(w.laws.iter().map(|l| l.pushes[0].0));
        w.laws.iter().map(move |l| l.pushes[0].0 / mean)
    });
    let (_, size) = spread(sizes);
    assert!((size / recorded::SIZE_SPREAD - 1.0).abs() < 0.2, "{size}");
    let (mean, lift) = spread(laws().map(|l| l.lifts[0]));
    assert!((lift / recorded::LIFT_SPREAD - 1.0).abs() < 0.2 && mean.abs() < 0.02, "{mean} {lift}");
    let (mean, turn) = spread(laws().map(|l| l.turn));
    assert!((turn / recorded::TURN_SPREAD - 1.0).abs() < 0.2 && mean.abs() < 1e-3, "{mean} {turn}");
    for law in worlds.iter().flat_map(|w| &w.laws) {
        assert!(law.pushes.len() == 1 && law.clock == 1.0 && law.scale == 1.0);
    }
}

/// Camera errors: correlated noise, 2 % outliers, 3 % missing.
#[test]
fn recorded_noise_is_as_documented() {
    let (mut all, mut missing, mut far) = (0.0, 0.0, 0.0);
    let (mut square, mut beside, mut pairs) = (0.0, 0.0, 0.0);
    for seed in 0..4 {
        // Without a hidden effect a rolling ball differs from its clean twin only by the camera.
        let world = recorded::of_kind(Kind::Nothing(Motion::Rolls), true, seed);
        let off: Vec<f64> = points(&world).map(|(a, b)| (a - b) / world.noise).collect();
        all += off.len() as f64;
        missing += off.iter().filter(|v| v.is_nan()).count() as f64;
        far += off.iter().filter(|v| v.abs() > 3.5).count() as f64;
        for pair in off.windows(2).filter(|p| p.iter().all(|v| v.abs() < 3.0)) {
            square += pair[0] * pair[0];
            beside += pair[0] * pair[1];
            pairs += 1.0;
        }
    }
    assert!((missing / all - camera::MISSING).abs() < 0.01, "{}", missing / all);
    // Half of the outliers, whose direction is uniform, deviate that far along x.
    assert!((far / all - 0.5 * camera::OUTLIERS).abs() < 0.005, "{}", far / all);
    assert!((beside / square - camera::CORRELATION).abs() < 0.07, "{}", beside / square);
    assert!((square / pairs - 1.0f64).abs() < 0.1, "{}", square / pairs);
}

/// Linear drag has a closed-form path; only integration error and a micrometre of noise remain.
#[test]
fn clean_twin_follows_analytic_drag() {
    let world = recorded::of_kind(Kind::Single(0), false, 5);
    let c = world.sizes[0].value;
    let drag: crate::worlds::Force = std::sync::Arc::new(move |_, s| [-c * s[2], -c * s[3]]);
    let law = Law { pushes: vec![(1.0, drag)], ..Law::plain(0.0, 0.0) };
    let (v, times) = ([3.0, 4.0], [0.0, 0.3, 1.0]);
    for (t, seen) in times.iter().zip(law.seen(Motion::Flies, [0.0, 1.0, v[0], v[1], 0.0, 0.0], &times)) {
        let gone = -(-c * t).exp_m1() / c;
        let exact = [v[0] * gone, 1.0 + (v[1] + 9.81 / c) * gone - 9.81 / c * t];
        assert!((0..2).all(|i| (seen[i] - exact[i]).abs() < 1e-9), "{seen:?} {exact:?}");
    }
    // The clean twin's first flight follows the same law.
    let track = &world.clean[0].observed;
    let (x, t) = (&track.bodies[0].x, &track.times);
    let speed = (x[20] - x[0]) * c / -(-c * t[20]).exp_m1();
    for (x, t) in x.iter().zip(t) {
        let exact = track.bodies[0].x[0] + speed * -(-c * t).exp_m1() / c;
        assert!((x - exact).abs() < 1e-5, "{x} {exact}");
    }
}

/// A frictionless bounce rebounds to the analytic height, wherever in a step it occurs.
#[test]
fn bounce_reaches_analytic_height() {
    let law = Law { slope: 0.02, ..Law::plain(0.8, 0.0) };
    let (drop, g): (f64, f64) = (1.0, 9.81);
    let (met, speed) = ((2.0 * drop / g).sqrt(), (2.0 * drop * g).sqrt());
    let up = (0.8 - 0.02 * speed) * speed;
    let times = [0.0, met + up / g];
    let seen = law.seen(Motion::Bounces, [0.0, 0.05 + drop, 1.0, 0.0, 0.0, 0.0], &times);
    assert!((seen[1][1] - (0.05 + up * up / (2.0 * g))).abs() < 1e-6, "{seen:?}");
    assert!((seen[1][0] - times[1]).abs() < 1e-9);
}

/// Vanishing bounces end in rolling: v falls to 2/3 by the inertia of a full disc.
#[test]
fn bouncing_ends_in_rolling() {
    let law = Law::plain(0.3, 0.4);
    let seen = law.seen(Motion::Bounces, [0.0, 0.15, 1.0, 0.0, 0.0, 0.0], &[0.0, 1.5, 2.0]);
    assert!(seen[1..].iter().all(|p| (p[1] - 0.05).abs() < 1e-5), "{seen:?}");
    let speed = (seen[2][0] - seen[1][0]) / 0.5;
    assert!((speed - 2.0 / 3.0).abs() < 1e-3, "{speed}");
    assert!(((seen[1][2] - seen[2][2]) / 0.5 - speed / 0.05).abs() < 0.05, "{seen:?}");
}

/// Wilson's interval against values computed by hand.
#[test]
fn wilson_interval_matches_hand_computation() {
    let near = |right, all, expected: [f64; 2]| {
        let own = crate::worlds::study::wilson(right, all);
        assert!((0..2).all(|i| (own[i] - expected[i]).abs() < 1e-4), "{right} of {all}: {own:?}");
    };
    near(0, 10, [0.0, 0.2775]);
    near(5, 10, [0.2366, 0.7634]);
    near(81, 100, [0.7222, 0.8749]);
}
