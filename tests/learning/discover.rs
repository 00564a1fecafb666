//! Diagnosis: effects hidden by an independent integrator are named, their absence is recognised, and reports
//! keep their format.

use crate::worlds::{self, HiddenForce, NOISES, Noise, SINGLES};
use crate::{all_cases, cases};
use iplw::experiment::EstimateConfig;
use iplw::experiment::extension::{diagnose_trials, extend_simulation};
use iplw::inference::report::{Diagnosis, Verdict};
use iplw::inference::{DiagnosisConfig, DiagnosisResult, diagnose};
use iplw::progress::NoProgress;
use iplw::reality::{HiddenConfig, HiddenWorld, Trial, standard, trials_from_csv, with_trial_settings};
use iplw::task::Scene;
use iplw::task::scene::EffectTerm;
use iplw::task::{Family, Split, split};
use iplw::trajectory::Trajectory;
use iplw::world::effect::linear_drag;
use iplw::world::{Engine, Latents, Rollout, Simulator};

fn look(hidden: &HiddenForce, noise: Noise, seed: u64) -> DiagnosisResult {
    let trials = worlds::trials(hidden, noise, 10, 30, 8.0, seed);
    diagnose(&worlds::scene(), &trials, &DiagnosisConfig::standard(seed), &NoProgress).unwrap()
}

fn holds(d: &Diagnosis, hidden: &HiddenForce) -> bool {
    let mut truth = hidden.names.clone();
    truth.sort_unstable();
    d.rivals.iter().any(|r| r.iter().map(String::as_str).eq(truth.iter().copied()))
}

#[test]
fn pure_noise_has_no_effect() {
    for (i, noise) in NOISES.into_iter().enumerate().take(cases(2, NOISES.len())) {
        let d = look(&worlds::no_effect(), noise, 100 + i as u64).diagnosis;
        assert_eq!(d.verdict, Verdict::None, "{noise:?}: {}", d.reason);
        assert!(d.effects.is_empty() && d.rivals.is_empty());
    }
}

/// For identical trials without noise, no effect with between-trial variation is named.
#[test]
fn noiseless_flights_have_no_effect() {
    let mut csv = String::from("trial,t,body,x,y\n");
    for (trial, i) in (0..6).flat_map(|trial| (0..30).map(move |i| (trial, i))) {
        let t = 0.02 * f64::from(i);
        csv += &format!("{trial},{t},ball,{},{}\n", 2.0 * t, 1.0 + 3.0 * t - 4.905 * t * t);
    }
    let trials = trials_from_csv(&csv, &worlds::scene()).unwrap();
    let d =
        diagnose(&worlds::scene(), &trials, &DiagnosisConfig::standard(0), &NoProgress).unwrap().diagnosis;
    assert_eq!(d.verdict, Verdict::None, "{:?} {}", d.rivals, d.reason);
}

/// Contact effects are distinguished from flight effects: speed-dependent restitution, tangential restitution,
/// rolling resistance; a plain floor has none.
#[test]
fn names_hidden_contact_effects() {
    let seed = 1;
    for kind in [1, 4, 0, 2, 3].into_iter().take(cases(2, 5)) {
        let (truth, trials) = worlds::contact(kind, Noise::White, 12, 60, seed);
        let d = diagnose(&worlds::floor(), &trials, &DiagnosisConfig::standard(seed), &NoProgress)
            .unwrap()
            .diagnosis;
        match truth[..] {
            [] => assert_eq!(d.verdict, Verdict::None, "{}", d.reason),
            [name] => {
                assert!(d.rivals.iter().any(|r| r[..] == [name]), "{name}: {:?}, {}", d.rivals, d.reason)
            }
            _ => unreachable!("at most one effect is hidden"),
        }
    }
}

/// Root-mean-square distance, m, between a hidden world's paths and a scene's rollouts, for initial states that
/// were not fitted.
fn misses(scene: &Scene, hidden: &HiddenForce, engine: Engine) -> f64 {
    let starts: Vec<_> = worlds::launches(30, 987).into_iter().map(|(start, _)| (start, 0.9)).collect();
    let seen = worlds::thrown(hidden, Noise::White, &starts, 31, 0.0, 0);
    let thrown = |([x, y, vx, vy], _): &([f64; 4], f64)| {
        let mut scene = scene.clone();
        (scene.bodies[0].position, scene.bodies[0].velocity) = (Some([*x, *y]), [*vx, *vy]);
        (scene.time_step, scene.steps, scene.observe_every) = (1e-3, 900, 30);
        scene
    };
    let scenes: Vec<Scene> = starts.iter().map(thrown).collect();
    let rollout = |scene| Rollout { stop_at_goal: false, ..Rollout::of(scene) };
    let paths = Simulator::new(engine).run(&scenes.iter().map(rollout).collect::<Vec<_>>()).unwrap();
    let off = |(path, seen): (&Trajectory, &Trial)| -> Vec<f64> {
        let ([path], [seen]) = (&path.bodies[..], &seen.observed.bodies[..]) else {
            unreachable!("one ball")
        };
        assert_eq!(path.len(), seen.len());
        (0..path.len()).map(|i| (path.x[i] - seen.x[i]).powi(2) + (path.y[i] - seen.y[i]).powi(2)).collect()
    };
    let squares: Vec<f64> = paths.iter().zip(&seen).flat_map(off).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// A vortex is not in the library: the verdict is unknown, and the reported force field reduces the rollout
/// error on new trials to a quarter in both engines.
#[test]
fn unknown_force_is_described_and_simulated() {
    let hidden = worlds::outside(2, 5);
    let trials = worlds::trials(&hidden, Noise::White, 14, 40, 15.0, 5);
    let found = diagnose(&worlds::scene(), &trials, &DiagnosisConfig::standard(5), &NoProgress).unwrap();
    let setup = EstimateConfig::fast(iplw::task::family("basketball").unwrap().prior);
    let taught = extend_simulation(&found, &trials, &setup, Latents::default(), &NoProgress).unwrap();
    let d = found.diagnosis;
    assert_eq!(d.verdict, Verdict::Unknown, "{:?}: {}", d.rivals, d.reason);
    let left = d.field.as_ref().expect("a residual field");
    assert!(left.rows.iter().any(|r| r[2].hypot(r[3]) > 3.0 * r[4].hypot(r[5])), "{left:?}");
    let law = d.residual_law.expect("a residual law");
    assert!(law.formula.contains("place_push") && d.reason.contains(&law.formula), "{}", d.reason);
    // Although unnamed, the law improves held-out predictions and rollouts.
    let without = d.gain.held_out.map_or(law.held_out.base_rmse, |g| g.extended_rmse);
    assert!(law.offered && law.held_out.extended_rmse < 0.6 * without, "{law:?}");
    assert_eq!(taught.excess_removed, law.held_out.excess_removed);
    let scene = Scene::from_json(&found.extended.to_json()).unwrap();
    scene.validate().unwrap();
    assert!((3..=27).contains(&scene.effects.len()), "{:?}", scene.effects);
    for term in &law.terms {
        assert!(scene.effects.contains(&term.term), "{:?}", scene.effects);
        assert!(taught.effects.contains(&term.term), "{:?}", taught.effects);
        assert!(term.ci95.keys().all(|name| term.term.parameters.contains_key(name)), "{term:?}");
    }
    for engine in [Engine::Lanes, Engine::Rapier] {
        let [base, with] = [&worlds::scene(), &scene].map(|s| misses(s, &hidden, engine));
        assert!(with < 0.3 * base, "{engine:?}: {with} m with, {base} m without");
    }
}

/// A law of few trials through an annular force improves rollouts on new trials.
#[test]
fn law_of_few_trials_improves_rollouts() {
    let hidden = worlds::outside(4, 6);
    let trials = worlds::trials(&hidden, Noise::White, 14, 40, 15.0, 6);
    let found = diagnose(&worlds::scene(), &trials, &DiagnosisConfig::standard(1), &NoProgress).unwrap();
    let law = found.diagnosis.residual_law.expect("a residual law");
    assert!(law.offered && law.held_out.extended_rmse < 0.6 * law.held_out.base_rmse, "{law:?}");
    let [base, with] = [&worlds::scene(), &found.extended].map(|s| misses(s, &hidden, Engine::Auto));
    assert!(with < 0.6 * base, "{with} m, {base} m without");
}

/// Diagnosis of random actions in a task's hidden world, with full state at the paper's rate.
fn task(family: &str, effects: Vec<EffectTerm>, engine: Engine, seed: u64) -> Diagnosis {
    let family = iplw::task::family(family).unwrap();
    let count = if engine == Engine::Auto { 16 } else { cases(10, 16) };
    tried(family, HiddenConfig { effects, engine, ..standard(family) }, count, seed)
}

/// Diagnosis of `count` random actions in a task's hidden world.
fn tried(family: &'static Family, hidden: HiddenConfig, count: usize, seed: u64) -> Diagnosis {
    let mut world = HiddenWorld::new(hidden).unwrap();
    let tasks = split(&family.fold(0), Split::Train);
    let trials = iplw::experiment::random_trials(&tasks, &mut world, count, seed, &NoProgress).unwrap();
    let (scene, trials) = with_trial_settings(&tasks[0].scene, trials).unwrap();
    diagnose(&scene, &trials, &DiagnosisConfig::standard(seed), &NoProgress).unwrap().diagnosis
}

/// Noise-free latents far from their initial values are recovered together with the effect.
#[test]
fn names_effects_and_latents_of_tasks() {
    let right = |d: &Diagnosis| {
        let of = |name: &str| d.calibrated.iter().find(|c| c.name == name).unwrap().value;
        assert!((of("friction") - 0.2).abs() < 2e-3, "friction {}", of("friction"));
        assert!((of("restitution") - 0.7).abs() < 2e-3, "restitution {}", of("restitution"));
    };
    // Rounding errors have the same sign in all trials and must not count as an effect.
    for seed in [1, 101].into_iter().take(cases(1, 2)) {
        let d = task("basketball", Vec::new(), Engine::Auto, seed);
        assert_eq!(d.verdict, Verdict::None, "{}", d.reason);
        right(&d);
    }
    // The patch's drag is not a round number that a search could hit by chance.
    let patch: &[(&str, f64)] =
        &[("c", 2.271), ("x_min", 14.0), ("x_max", 28.0), ("y_min", 0.0), ("y_max", 6.0)];
    let hidden = [
        ("restitution_speed", &[("slope", 0.004)][..]),
        ("sticky_patch", patch),
        ("linear_drag", &[("c", 0.223)][..]),
    ];
    for (name, parameters) in hidden.into_iter().take(cases(1, 3)) {
        let of = |(p, v): &(&str, f64)| (p.to_string(), *v);
        let term = EffectTerm { name: name.into(), parameters: parameters.iter().map(of).collect() };
        let d = task("basketball", vec![term], Engine::Auto, 1);
        assert_eq!(d.rivals, [[name]], "{}", d.reason);
        let (size, value) = parameters[0];
        let found = d.effects[0].parameters.iter().find(|p| p.name == size).unwrap().value;
        assert!((found / value - 1.0).abs() < 0.01, "{:?}", d.effects);
        right(&d);
    }
}

/// Positions alone, a quarter of a second apart with 5 mm noise: segments from known initial states are used up
/// to the predictability horizon. (With three observations only, drag was confused with moving air, or with
/// less restitution.)
#[test]
fn names_drag_from_few_positions() {
    let family = iplw::task::family("bowling").unwrap();
    let parameters = [("c".to_string(), 0.223)].into();
    let effects = vec![EffectTerm { name: "linear_drag".into(), parameters }];
    let d = tried(family, HiddenConfig { effects, noise: 0.005, ..standard(family) }, 6, 2);
    assert_eq!(d.rivals, [["linear_drag"]], "{:?} {}", d.effects, d.reason);
    let c = d.effects[0].parameters[0].value;
    assert!((c / 0.223 - 1.0).abs() < 0.02, "{c}");
    let restitution = d.calibrated.iter().find(|c| c.name == "restitution").unwrap().value;
    assert!((restitution - f64::sqrt(0.2)).abs() < 0.01, "{restitution}");
}

/// Full states of a world with another integration scheme: its velocity offset is neither gravity nor hides a
/// wind.
#[test]
fn integration_scheme_is_not_an_effect() {
    let mut scene = worlds::scene();
    (scene.bodies[0].position, scene.steps, scene.observe_every) = (Some([0.0, 20.0]), 480, 60);
    scene.time_step = 1.0 / 240.0;
    let thrown = |effects: &[EffectTerm]| -> Vec<Trial> {
        let throw = |i: u32| {
            let mut scene = scene.clone();
            scene.bodies[0].velocity = [f64::from(i % 4) - 2.0, 0.5 * f64::from(i)];
            let rollout = Rollout { effects, stop_at_goal: false, ..Rollout::of(&scene) };
            let observed = Simulator::new(Engine::Rapier).run(&[rollout]).unwrap().remove(0);
            Trial { name: i.to_string(), setting: None, scene, observed }
        };
        let count = cases(7, 12) as u32;
        let mut trials: Vec<Trial> = (0..count).map(throw).collect();
        // A trial without observations does not invalidate the others.
        let mut unseen = throw(count);
        unseen.scene.bodies[0].position = None;
        unseen.observed.bodies[0].x.fill(f64::NAN);
        trials.insert(0, unseen);
        trials
    };
    let look = |effects: &[EffectTerm]| {
        diagnose(&scene, &thrown(effects), &DiagnosisConfig::standard(1), &NoProgress).unwrap().diagnosis
    };
    if all_cases() {
        let nothing = look(&[]);
        assert_eq!(nothing.verdict, Verdict::None, "{:?} {}", nothing.rivals, nothing.reason);
    }
    let parameters = [("ax".to_string(), 0.5), ("ay".to_string(), 0.0)].into();
    let windy = look(&[EffectTerm { name: "wind".into(), parameters }]);
    assert_eq!(windy.rivals, [["wind"]], "{:?} {}", windy.effects, windy.reason);
    let of = |i: usize| windy.effects[0].parameters[i].value;
    assert!((of(0) - 0.5).abs() < 0.02 && of(1).abs() < 0.02, "{:?}", windy.effects);
}

/// Bounces of another engine differ by centimetres; that is not an effect and hides none.
#[test]
fn contact_solver_is_not_an_effect() {
    if all_cases() {
        let nothing = task("basketball", Vec::new(), Engine::Rapier, 1);
        assert_eq!(nothing.verdict, Verdict::None, "{:?} {}", nothing.rivals, nothing.reason);
    }
    let term = EffectTerm { name: "linear_drag".into(), parameters: [("c".to_string(), 0.223)].into() };
    let drag = task("basketball", vec![term], Engine::Rapier, 1);
    assert_eq!(drag.rivals, [["linear_drag"]], "{}", drag.reason);
    let found = drag.effects[0].parameters[0].value;
    assert!((found / 0.223 - 1.0).abs() < 0.02, "{found}");
    let restitution = drag.calibrated.iter().find(|c| c.name == "restitution").unwrap().value;
    assert!((restitution - 0.7).abs() < 0.03, "{restitution}");
}

/// Every hidden effect is detected, and a named effect is the hidden one.
#[test]
fn detects_hidden_effects_without_misnaming() {
    let mut named = 0;
    let kinds: Vec<usize> = (0..SINGLES).step_by(if all_cases() { 1 } else { 3 }).collect();
    for &kind in &kinds {
        let hidden = worlds::single(kind, 7);
        let d = look(&hidden, NOISES[kind % 4], 200 + kind as u64).diagnosis;
        let sets = &d.rivals;
        assert_ne!(d.verdict, Verdict::None, "{:?} was not detected", hidden.names);
        if d.verdict == Verdict::Named {
            assert!(holds(&d, &hidden), "{:?} was named {sets:?}", hidden.names);
            named += 1;
        }
    }
    assert!(named >= kinds.len() / 2, "only {named} of {} were named", kinds.len());
}

/// Moving air resembles drag with wind: the pair is tried although other models look better at first.
#[test]
fn reports_pairs_of_effects() {
    for (kind, seed) in [(3, 33), (0, 31), (1, 32)].into_iter().take(cases(1, 3)) {
        let hidden = worlds::double(kind, seed);
        let d = look(&hidden, Noise::White, seed).diagnosis;
        assert!(holds(&d, &hidden), "{:?}: {:?}, {}", hidden.names, d.rivals, d.reason);
    }
}

/// Faint drag fits both laws; the recommended experiment discriminates them.
#[test]
fn recommended_experiment_discriminates_drag_laws() {
    let (hidden, seed) = (worlds::single(1, 3), 5);
    let trials = worlds::trials(&hidden, Noise::White, 10, 30, 3.5, seed);
    let scene = worlds::scene();
    let d = diagnose(&scene, &trials, &DiagnosisConfig::standard(1), &NoProgress).unwrap().diagnosis;
    assert_eq!(d.verdict, Verdict::Ambiguous, "{:?}", d.rivals);
    let next = d.next_experiment.expect("rivals tie");
    let advised = next.scene.expect("an experiment is recommended").bodies[0].clone();
    let [x, y] = advised.position.expect("it has a position");
    let start = [x, y, advised.velocity[0], advised.velocity[1]];
    let sd = worlds::noise_sd(&hidden, 10, 30, 3.5, seed);
    let more = worlds::thrown(&hidden, Noise::White, &[(start, 1.0); 6], 30, sd, 77);
    let all: Vec<_> = trials.into_iter().chain(more).collect();
    let d = diagnose(&scene, &all, &DiagnosisConfig::standard(1), &NoProgress).unwrap().diagnosis;
    assert_eq!((d.verdict, d.rivals), (Verdict::Named, vec![vec!["quadratic_drag".to_string()]]));
}

/// Every trial has estimates of the reported model and a predictive check.
fn check_per_trial_entries(json: &serde_json::Value) {
    let list = |v: &serde_json::Value| v.as_array().unwrap().clone();
    let (launches, predicted) = (list(&json["launches"]), list(&json["predictive"]["launches"]));
    assert_eq!((launches.len(), predicted.len()), (10, 10));
    let effect = &json["effects"][0];
    for (i, launch) in launches.iter().enumerate() {
        assert_eq!(
            (launch["trial"].as_u64(), &launch["sizes"][0]["effect"]),
            (Some(i as u64), &effect["name"])
        );
        let size = &launch["sizes"][0];
        assert!(size["sd"].as_f64().unwrap() > 0.0 && size["value"].is_number(), "{size}");
    }
    assert!(predicted.iter().all(|p| (0.0..=1.0).contains(&p["p"].as_f64().unwrap())));
    assert_eq!(list(&json["predictive"]["sorted"]).len(), 10);
    let (paths, columns) = (list(&json["paths"]["launches"]), list(&json["paths"]["columns"]));
    assert!(
        paths.len() == 10
            && paths.iter().flat_map(|p| list(&p["rows"])).all(|r| list(&r).len() == columns.len())
    );
    let tied = json["scores"].as_array().unwrap().iter().filter(|s| !list(&s["sizes"]).is_empty());
    assert!(
        tied.clone().count() >= 1
            && tied.clone().all(|s| list(&s["effects"]).len() == list(&s["sizes"]).len())
    );
}

#[test]
fn report_has_its_fields_and_extended_scene_simulates() {
    let hidden = worlds::single(1, 3);
    let found = look(&hidden, Noise::White, 5);
    let json = serde_json::to_value(&found.diagnosis).unwrap();
    let fields = [
        "format",
        "verdict",
        "effects",
        "rivals",
        "calibrated",
        "residual",
        "gain",
        "unexplained_share",
        "next_experiment",
        "launches",
        "predictive",
        "paths",
        "field",
    ];
    for field in fields {
        assert!(json.get(field).is_some(), "{field} is missing");
    }
    assert_eq!(json["format"], "iplw.diagnosis/2");
    check_per_trial_entries(&json);
    let excess = found.diagnosis.gain.held_out.as_ref().unwrap().excess_removed.unwrap();
    assert!(excess > 0.9, "{excess}");
    found.extended.validate().unwrap();
    let rollout = Rollout::of(&found.extended);
    let path = Simulator::new(Engine::Auto).run(&[rollout]).unwrap();
    assert!(path[0].times.len() > 1);
    assert!(!found.extended.effects.is_empty());
    assert!(!found.evidence.points.is_empty());
}

#[test]
fn is_deterministic_across_threads() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| look(&worlds::single(2, 4), Noise::Correlated, 9));
        serde_json::to_string(&found.diagnosis).unwrap()
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn reports_insufficient_data() {
    let hidden = worlds::single(2, 4);
    let few = worlds::trials(&hidden, Noise::White, 3, 40, 8.0, 1);
    let short = worlds::trials(&hidden, Noise::White, 10, 5, 8.0, 1);
    for (trials, is_fitted) in [(few, true), (short, false)] {
        let d = diagnose(&worlds::scene(), &trials, &DiagnosisConfig::standard(0), &NoProgress)
            .unwrap()
            .diagnosis;
        assert_eq!(d.verdict, Verdict::InsufficientData);
        assert!(!d.reason.is_empty() && d.effects.is_empty());
        // What each effect alone would be, with an interval.
        assert_eq!(d.scores.iter().any(|s| !s.sizes.is_empty()), is_fitted, "{}", d.reason);
        assert_eq!(d.reason.contains("alone"), is_fitted, "{}", d.reason);
    }
}

/// One throw with drag: its size is estimated, but nothing is named.
#[test]
fn one_trial_gives_sizes_without_a_name() {
    let hidden = worlds::single(1, 4);
    let Some((_, _, truth)) = hidden.parameter else { panic!("a drag") };
    let trials = worlds::trials(&hidden, Noise::White, 1, 60, 30.0, 7);
    let d =
        diagnose(&worlds::scene(), &trials, &DiagnosisConfig::standard(0), &NoProgress).unwrap().diagnosis;
    assert_eq!(d.verdict, Verdict::InsufficientData);
    let drag = d.scores.iter().find(|s| s.effects == ["quadratic_drag"]).and_then(|s| s.sizes.first());
    let Some(drag) = drag else { panic!("{}", d.reason) };
    let [Some(low), Some(high)] = drag.parameters[0].ci95 else { panic!("{drag:?}") };
    assert!((low..high).contains(&truth) && high < 2.0 * low, "{drag:?}");
}

/// A simulation is extended by the selected effects, without duplicating those of its scene.
#[test]
fn extension_excludes_existing_effects() {
    let mut trials = worlds::trials(&worlds::single(2, 4), Noise::White, 3, 40, 8.0, 1);
    trials.iter_mut().for_each(|t| t.scene.effects.push(linear_drag(0.1)));
    let setup = EstimateConfig::fast(iplw::task::family("basketball").unwrap().prior);
    let (_, found) = diagnose_trials(&trials, &setup, &NoProgress).unwrap();
    assert_eq!(found.extended.effects, [linear_drag(0.1)]);
    assert!(
        extend_simulation(&found, &trials, &setup, Latents::default(), &NoProgress)
            .unwrap()
            .effects
            .is_empty()
    );
}
