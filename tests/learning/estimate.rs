//! Estimation: hidden latents are recovered, unidentifiable ones are reported, racing is exact, and results are
//! deterministic across threads.

use crate::cases;
use iplw::error::{Error, Result};
use iplw::estimate::TrialSegment;
use iplw::estimate::loss::{Racing, Simulation, segment_losses};
use iplw::experiment::{
    EstimateConfig, EstimateReport, Memory, OrderConstraint, ProposalResult, ResidualKind, Round, StopReason,
    Workflow, estimate, random_trials, refit, run as run_workflow,
};
use iplw::progress::{NoProgress, Progress};
use iplw::reality::{HiddenConfig, HiddenWorld, Reality, standard, trials_from_csv, trials_to_csv};
use iplw::task::scene::EffectTerm;
use iplw::task::{Split, Task, family, split};
use iplw::world::{EffectParameter, Engine, Latents, latent::FACTORS};

fn training(name: &str) -> Vec<Task> {
    split(&family(name).unwrap().tasks(), Split::Train)
}

fn hidden(name: &str, latents: [f64; 3], damped: bool) -> HiddenConfig {
    let standard = standard(family(name).unwrap());
    let effects = if damped { standard.effects.clone() } else { Vec::new() };
    HiddenConfig { latents: Latents::of(latents), effects, ..standard }
}

fn run(name: &str, world: HiddenConfig, config: EstimateConfig) -> EstimateReport {
    let mut world = HiddenWorld::new(world).unwrap();
    estimate(&training(name), &mut world, &config, &NoProgress).unwrap().0
}

fn fast(name: &str) -> EstimateConfig {
    EstimateConfig::fast(family(name).unwrap().prior)
}

/// Restitution hidden in basketball, with an otherwise correct model, is recovered to 2 % of its range.
#[test]
fn recovers_restitution_in_basketball() {
    for (truth, seed) in [(0.45, 1), (0.85, 2)].into_iter().take(cases(1, 2)) {
        let report = run(
            "basketball",
            hidden("basketball", [1.0, 0.2, truth], false),
            EstimateConfig { seed, ..fast("basketball") },
        );
        let found = &report.latents[2];
        assert!(found.identifiable, "{found:?}");
        assert!((found.value - truth).abs() < 0.02, "{found:?} for {truth}");
    }
}

/// Both coefficients hidden in bowling, with an otherwise correct model. Chaos after collisions makes the
/// residual rough, so the tolerance is 10 % of the prior's width.
#[test]
fn recovers_bowling_coefficients_and_reports_unidentifiable_density() {
    let truth = [0.25, 0.5, 0.6];
    let report =
        run("bowling", hidden("bowling", truth, false), EstimateConfig { seed: 3, ..fast("bowling") });
    for i in 1..3 {
        let width = 4.0 * family("bowling").unwrap().prior[i].1;
        let off = (report.latents[i].value - truth[i]).abs() / width;
        assert!(report.latents[i].identifiable && off < 0.1, "{} off by {off} of its width", FACTORS[i].name);
    }
    assert!(
        !report.latents[0].identifiable,
        "all bodies share one density, so it cancels: {:?}",
        report.latents[0]
    );
    assert_eq!(report.latents[0].ci95, [None, None]);
}

#[test]
fn racing_preserves_elites() {
    for (name, seed) in [("basketball", 5), ("bowling", 6)] {
        let mut world = HiddenWorld::new(hidden(name, [0.5, 0.4, 0.6], true)).unwrap();
        let count = if name == "bowling" { 14 } else { 24 };
        let trials = random_trials(&training(name), &mut world, count, seed, &NoProgress).unwrap();
        let mut stream = iplw::rng::stream(seed, "cem");
        let cem =
            iplw::estimate::Cem::new(iplw::estimate::CemConfig::fast(family(name).unwrap().prior)).unwrap();
        let samples = cem.ask(&mut stream);
        let coordinates = iplw::world::ParameterSpace::new(&[]);
        let simulation = Simulation { engine: Engine::Auto, effects: &[], coordinates: &coordinates };
        let segments = TrialSegment::whole_trials(&trials);
        let slow = segment_losses(&samples, &segments, simulation, Racing::Off, &NoProgress).unwrap();
        let raced =
            segment_losses(&samples, &segments, simulation, Racing::On { elites: 12 }, &NoProgress).unwrap();
        let best = |values: &[f64]| {
            let mut order: Vec<usize> = (0..values.len()).collect();
            order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
            order.truncate(12);
            order.into_iter().map(|i| (i, values[i].to_bits())).collect::<Vec<_>>()
        };
        assert_eq!(best(&slow.values), best(&raced.values), "{name}");
        assert!(raced.rollouts < slow.rollouts, "{name}: nothing was dropped");
    }
}

#[test]
fn is_deterministic_across_threads() {
    let small = EstimateConfig { rounds: 2, actions: 5, candidates: 40, ..fast("basketball") };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run("basketball", hidden("basketball", [1.0, 0.2, 0.7], true), small.clone()))
    };
    assert_eq!(on(1), on(3));
    let other = run(
        "basketball",
        hidden("basketball", [1.0, 0.2, 0.7], true),
        EstimateConfig { seed: 9, ..small.clone() },
    );
    assert_ne!(on(1).estimates, other.estimates, "the seed matters");
}

/// Rounds pass through JSON, as in a store; a workflow resumed from any round ends bit-identically.
#[test]
fn resumed_workflow_is_bit_identical() {
    let config = EstimateConfig { rounds: 4, actions: 5, candidates: 40, settled: 0.0, ..fast("basketball") };
    let tasks = training("basketball");
    let world = || HiddenConfig { noise: 0.01, ..hidden("basketball", [1.0, 0.2, 0.7], true) };
    let through = |rounds: Vec<Round>| {
        let mut reality = HiddenWorld::new(world())
            .unwrap()
            .with_spent(rounds.iter().map(|r| r.answers.len() as u64).sum());
        let text = serde_json::to_string(&rounds).unwrap();
        let rounds: Vec<Round> = serde_json::from_str(&text).unwrap();
        let mut workflow = Workflow::new(&tasks, &config, None).unwrap().resume(rounds).unwrap();
        let mut kept = Vec::new();
        run_workflow(&mut workflow, &mut reality, &NoProgress, &mut |r| {
            kept.push(r.clone());
            Ok(())
        })
        .unwrap();
        (workflow.report(&NoProgress).unwrap(), workflow.rounds().to_vec(), kept.len())
    };
    let (report, rounds, kept) = through(Vec::new());
    assert_eq!(kept, 4);
    for n in 1..=4 {
        let (again, all, kept) = through(rounds[..n].to_vec());
        // Compared as text: unobserved values are NaN.
        let text = serde_json::to_string(&rounds).unwrap();
        assert_eq!((&again, kept), (&report, 4 - n), "resumed after round {n}");
        assert!(serde_json::to_string(&all).unwrap() == text, "resumed after round {n}");
    }
}

/// Answers may arrive in any order, repeated or not at all; unrequested ones are rejected without change.
#[test]
fn accepts_answers_in_any_order() {
    let config = EstimateConfig { rounds: 2, actions: 4, candidates: 40, ..fast("basketball") };
    let tasks = training("basketball");
    let mut reality = HiddenWorld::new(hidden("basketball", [1.0, 0.2, 0.7], true)).unwrap();
    let start = || Workflow::new(&tasks, &config, None).unwrap();
    let mut workflow = start();
    assert!(matches!(workflow.tell(&[], &NoProgress), Err(Error::Refused { .. })), "nothing was asked yet");
    let proposals = workflow.propose(None, &NoProgress).unwrap().unwrap();
    assert_eq!(
        workflow.propose(None, &NoProgress).unwrap().unwrap(),
        proposals,
        "proposing twice gives the same"
    );
    let mut answers: Vec<ProposalResult> = proposals
        .iter()
        .map(|p| {
            let task = workflow.task(&p.task).unwrap();
            let attempt = reality.measure(task, &[p.action_on(task).unwrap()]).unwrap().remove(0);
            ProposalResult { number: p.number, observed: attempt.trajectory.unwrap() }
        })
        .collect();
    let stray = [ProposalResult { number: 99, ..answers[0].clone() }];
    assert!(workflow.tell(&stray, &NoProgress).unwrap_err().to_string().contains("0 to 3"));
    assert!(workflow.rounds().is_empty());
    let straight = workflow.tell(&answers, &NoProgress).unwrap().clone();
    answers.reverse();
    answers.push(answers[0].clone());
    let mut shuffled = start();
    shuffled.propose(None, &NoProgress).unwrap();
    assert_eq!(*shuffled.tell(&answers, &NoProgress).unwrap(), straight);
    let mut partial = start();
    partial.propose(None, &NoProgress).unwrap();
    assert_eq!(partial.tell(&answers[..2], &NoProgress).unwrap().answers.len(), 2);
    partial.propose(None, &NoProgress).unwrap();
    partial.tell(&[], &NoProgress).unwrap();
    assert_eq!((partial.ended(), partial.trials().len()), (Some(StopReason::Rounds), 2));
}

#[test]
fn respects_and_reports_budget() {
    let world = HiddenConfig { budget: Some(7), ..hidden("basketball", [1.0, 0.2, 0.7], true) };
    let config = EstimateConfig {
        rounds: 4,
        actions: 5,
        candidates: 40,
        memory: Memory::LastRound,
        ..fast("basketball")
    };
    let report = run("basketball", world, config);
    assert_eq!((report.real_interactions, report.stopped), (7, StopReason::Budget));
}

#[test]
fn exhausted_budget_rejects_without_counting() {
    let tasks = training("basketball");
    let mut world =
        HiddenWorld::new(HiddenConfig { budget: Some(1), ..hidden("basketball", [1.0, 0.2, 0.7], true) })
            .unwrap();
    let actions: Vec<_> = (0..20_000).step_by(400).map(|i| tasks[0].actions().at(i).unwrap()).collect();
    assert!(matches!(world.measure(&tasks[0], &actions), Err(Error::Budget { limit: 1, spent: 0, .. })));
    assert_eq!(world.interactions(), 0);
}

#[test]
fn noise_is_seeded_and_has_its_sd() {
    let tasks = training("basketball");
    let observe = |noise, seed| {
        let mut world =
            HiddenWorld::new(HiddenConfig { noise, seed, ..hidden("basketball", [1.0, 0.2, 0.7], true) })
                .unwrap();
        random_trials(&tasks, &mut world, 30, 4, &NoProgress).unwrap()
    };
    let (clean, noisy) = (observe(0.0, 1), observe(0.05, 1));
    // Compared as text: unobserved values are NaN.
    let text = |trials: &[iplw::reality::Trial]| format!("{trials:?}");
    assert!(text(&noisy) == text(&observe(0.05, 1)));
    assert!(text(&noisy) != text(&observe(0.05, 2)));
    let differences: Vec<f64> = clean
        .iter()
        .zip(&noisy)
        .flat_map(|(a, b)| {
            a.observed.bodies[0].x[1..].iter().zip(&b.observed.bodies[0].x[1..]).map(|(p, q)| p - q)
        })
        .collect();
    let sd = (differences.iter().map(|d| d * d).sum::<f64>() / differences.len() as f64).sqrt();
    assert!((0.04..0.06).contains(&sd), "{sd} from {} differences", differences.len());
}

/// Cancellation is reported as such from any stage.
#[test]
fn cancellation_is_reported() {
    struct After(std::sync::atomic::AtomicU64);
    impl Progress for After {
        fn report(&self, _: &str, _: u64, _: u64) -> Result<()> {
            let left = self.0.fetch_update(
                std::sync::atomic::Ordering::SeqCst,
                std::sync::atomic::Ordering::SeqCst,
                |n| n.checked_sub(1),
            );
            left.map(drop).map_err(|_| Error::Cancelled)
        }
    }
    for reports in [0, 1, 5, 30] {
        let mut world = HiddenWorld::new(hidden("basketball", [1.0, 0.2, 0.7], true)).unwrap();
        let stop = After(std::sync::atomic::AtomicU64::new(reports));
        let ended = estimate(&training("basketball"), &mut world, &fast("basketball"), &stop);
        assert_eq!(ended.unwrap_err(), Error::Cancelled);
    }
}

#[test]
fn rejects_invalid_config_by_name() {
    let base = fast("bowling");
    let with = |change: fn(&mut EstimateConfig)| {
        let mut config = base.clone();
        change(&mut config);
        config.validate().unwrap_err().to_string()
    };
    assert!(with(|c| c.strategy = "psychic".into()).contains("psychic"));
    assert!(with(|c| c.rounds = 0).contains("rounds"));
    assert!(with(|c| c.actions = 0).contains("actions"));
    assert!(with(|c| c.candidates = 1).contains("candidates"));
    assert!(with(|c| c.cem.elites = 1).contains("elites"));
    assert!(with(|c| c.cem.smoothing = f64::NAN).contains("smoothing"));
    assert!(with(|c| c.cem.limits = Some([[0.0, 1.0]; 3])).contains("limits[0][0]"));
    assert!(with(|c| c.cem.prior[1].1 = 0.0).contains("prior[1][1]"));
    let along =
        |c: &mut EstimateConfig, name| c.cem.add_free_parameter(EffectParameter::parse(name).unwrap());
    let twice =
        with(|c| (0..2).for_each(|_| c.cem.add_free_parameter(EffectParameter::parse("wind.ax").unwrap())));
    assert!(twice.contains("cem.fit[1].parameter") && twice.contains("wind.ax"), "{twice}");
    // A gust's period is unidentifiable unless its amplitude is estimated.
    let mut still = base.clone();
    along(&mut still, "gust.period");
    let said = still.validate().unwrap_err().to_string();
    assert!(said.contains("gust.period") && said.contains("gust.ax or gust.ay"), "{said}");
    along(&mut still, "gust.ay");
    still.validate().unwrap();
}

/// Every segment starts from an observed state, so chaos does not accumulate: ten trials of bowling suffice.
#[test]
fn shooting_recovers_bowling_from_ten_trials() {
    let truth = [0.25, 0.5, 0.6];
    let config = EstimateConfig { rounds: 1, residual: ResidualKind::Shooting, seed: 4, ..fast("bowling") };
    let report = run("bowling", hidden("bowling", truth, false), config);
    assert_eq!(report.real_interactions, 10);
    for (found, truth) in report.latents.iter().zip(truth).skip(1) {
        assert!(found.identifiable && (found.value - truth).abs() < 0.005, "{found:?} for {truth}");
    }
    assert!(!report.latents[0].identifiable);
}

/// Any effect parameter can be estimated by name: hidden in bowling together with both coefficients, it is
/// recovered to a tenth of its prior's width and leaves the latents unbiased. A wind with two components is one
/// effect.
#[test]
fn estimates_effect_parameters_by_name() {
    let planted: [&[(&str, f64)]; 3] = [
        &[("quadratic_drag.k", 0.03)],
        &[("wind.ax", -0.4), ("wind.ay", 0.2)],
        &[("linear_drag.c", 0.223), ("rolling_resistance.crr", 0.05)],
    ];
    let truth = [0.25, 0.5, 0.6];
    for (values, seed) in planted.into_iter().zip([21, 22, 23]).rev().take(cases(1, 3)) {
        let parse = |name: &str| EffectParameter::parse(name).unwrap();
        let fitted: Vec<EffectParameter> = values.iter().map(|(name, _)| parse(name)).collect();
        let mut config =
            EstimateConfig { seed, residual: ResidualKind::Shooting, rounds: 3, ..fast("bowling") };
        fitted.iter().for_each(|p| config.cem.add_free_parameter(*p));
        let coordinates = config.cem.coordinates();
        // Drag that is not estimated is 0 in the hidden point, too.
        let of = |i: usize| values.iter().find(|(n, _)| *n == coordinates.name(i)).map_or(0.0, |(_, v)| *v);
        let at: Vec<f64> = (0..coordinates.len()).map(|i| truth.get(i).copied().unwrap_or(of(i))).collect();
        let effects = coordinates.effects(&at, &[]);
        let world = HiddenConfig { effects: effects.clone(), ..hidden("bowling", truth, false) };
        let report = run("bowling", world, config);
        for i in 1..3 {
            let width = 4.0 * family("bowling").unwrap().prior[i].1;
            let off = (report.latents[i].value - truth[i]).abs() / width;
            assert!(off < 0.1, "{} off by {off} of its width with {fitted:?}", FACTORS[i].name);
        }
        let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
        assert_eq!(names, values.iter().map(|(n, _)| *n).collect::<Vec<_>>());
        for (found, (own, (_, truth))) in report.effects.iter().zip(fitted.iter().zip(values)) {
            let (off, width) = ((found.value - truth).abs(), 4.0 * own.parameter().weak_prior().1);
            eprintln!("{}: {:.4} for {truth}, {:?}", found.name, found.value, found.ci95);
            assert!(found.identifiable && off < 0.1 * width, "{found:?} for {truth}");
        }
        let names = |terms: &[EffectTerm]| terms.iter().map(|t| t.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&report.extension()), names(&effects));
        assert_eq!(report.estimates[0].len(), coordinates.len());
    }
}

#[test]
fn shooting_needs_no_velocities() {
    let mut tasks = training("basketball");
    tasks.truncate(1);
    let truth = [1.0, 0.2, 0.7];
    let world = HiddenConfig { noise: 0.01, ..hidden("basketball", truth, false) };
    let measured = random_trials(&tasks, &mut HiddenWorld::new(world).unwrap(), 25, 3, &NoProgress).unwrap();
    assert!(measured[0].observed.bodies[0].vx[1].is_nan(), "with noise, velocities are not seen");
    let read: Vec<_> = measured
        .iter()
        .map(|t| {
            let mut blind = t.clone();
            blind.observed.bodies[0].angle.iter_mut().for_each(|a| *a = f64::NAN);
            let csv = trials_to_csv(&[blind]);
            trials_from_csv(&csv, &t.scene).unwrap().remove(0)
        })
        .collect();
    assert!(read.iter().all(|t| t.observed.bodies[0].vx.iter().all(|v| v.is_nan())));
    let config =
        EstimateConfig { rounds: 1, residual: ResidualKind::Shooting, seed: 1, ..fast("basketball") };
    let report = refit(&read, &config, &NoProgress).unwrap();
    let found = &report.latents[2];
    assert!(found.identifiable && (found.value - truth[2]).abs() < 0.01, "{found:?}");
}

/// Racing over segments is exact, and independent of the number of threads.
#[test]
fn shooting_race_is_exact_and_deterministic() {
    let world = || HiddenConfig { noise: 0.01, ..hidden("basketball", [1.0, 0.2, 0.7], false) };
    let small = EstimateConfig {
        rounds: 2,
        actions: 5,
        candidates: 50,
        residual: ResidualKind::Shooting,
        ..fast("basketball")
    };
    let slow = run("basketball", world(), EstimateConfig { racing: false, ..small.clone() });
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run("basketball", world(), small.clone()))
    };
    let raced = on(1);
    assert_eq!((&raced.latents, &raced.estimates), (&slow.latents, &slow.estimates));
    assert!(raced.rollouts < slow.rollouts);
    assert_eq!(raced, on(3));
}

/// A ball that never slips only bounds friction from below. A sensed range narrows the estimate and is never
/// violated.
#[test]
fn sensed_ranges_constrain_estimates() {
    let truth = [1.0, 0.9, 0.6];
    let with = |senses: &[&str], seed| {
        let senses = senses.iter().map(|s| OrderConstraint::parse(s).unwrap()).collect();
        let config = EstimateConfig { rounds: 2, seed, senses, ..fast("basketball") };
        run("basketball", hidden("basketball", truth, false), config)
    };
    let mut off = [0.0; 2];
    for seed in 0..cases(2, 4) as u64 {
        let (open, sensed) = (with(&[], seed), with(&["friction>0.8", "friction<1.0"], seed));
        for estimate in &sensed.estimates {
            assert!((0.8..=1.0).contains(&estimate[1]), "left the sensed range: {estimate:?}");
        }
        for (sum, report) in off.iter_mut().zip([&sensed, &open]) {
            *sum += (report.latents[1].value - truth[1]).abs();
        }
    }
    assert!(off[0] < off[1], "sensing made it worse over all: {off:?}");
    // Even a wrong one.
    let wrong = with(&["restitution>0.7"], 1);
    assert!(wrong.estimates.iter().all(|e| e[2] >= 0.7), "{wrong:?}");
    let open = wrong.latents[2].ci95[0];
    assert!(open.is_none_or(|low| low >= 0.7), "the interval left the sensed range");
}
