//! Lack of fit of an estimation: bad where the real world has an effect that the simulation lacks, good where it has none.

use iplw::experiment::{EstimateConfig, EstimateReport, ResidualKind, estimate};
use iplw::progress::NoProgress;
use iplw::reality::{HiddenConfig, HiddenWorld, standard};
use iplw::task::scene::EffectTerm;
use iplw::task::{Split, family, split};

/// One term in turn: drag, wind, a quadratic drag, or stronger gravity.
fn hidden_effect(case: u64) -> EffectTerm {
    let (name, parameter, value) = [
        ("linear_drag", "c", 0.2),
        ("wind", "ax", 0.5),
        ("quadratic_drag", "k", 0.03),
        ("gravity_error", "dg", 1.0),
    ][case as usize % 4];
    EffectTerm { name: name.into(), parameters: [(parameter.to_string(), value)].into() }
}

/// An estimation of ten interactions with 5 mm of noise on every position, in families in turn.
fn estimated(case: u64, effects: Vec<EffectTerm>) -> EstimateReport {
    let family = family(["basketball", "bowling"][case as usize % 2]).unwrap();
    let seed = 510 + case;
    let hidden = HiddenConfig { noise: 0.005, seed, effects, ..standard(family) };
    let config = EstimateConfig {
        strategy: "random".into(),
        residual: ResidualKind::Shooting,
        rounds: 1,
        actions: 10,
        seed,
        ..EstimateConfig::fast(family.prior)
    };
    let tasks = split(&family.tasks(), Split::Train);
    estimate(&tasks, &mut HiddenWorld::new(hidden).unwrap(), &config, &NoProgress).unwrap().0
}

#[test]
fn a_hidden_effect_makes_a_bad_fit_and_none_a_good_one() {
    let n = super::cases(4, 20) as u64;
    let bad = |effects: fn(u64) -> Vec<EffectTerm>| {
        (0..n).filter(|case| estimated(*case, effects(*case)).has_bad_fit()).count() as u64
    };
    let found = bad(|case| vec![hidden_effect(case / 2)]);
    let false_alarms = bad(|_| Vec::new());
    println!("bad fits: {found} of {n} with a hidden effect, {false_alarms} of {n} without");
    assert!(found * 20 >= 19 * n, "{found} of {n}");
    assert!(false_alarms * 20 <= n, "{false_alarms} of {n}");
}
