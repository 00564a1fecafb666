//! Set-ups as people have them: clocks and lengths that are wrong by any factor, strong drag, balls that are held first, a trial
//! of another kind, floors off their height, friction that always grips, and errors that all trials share.

use std::sync::Arc;

use iplw::inference::report::{Diagnosis, Verdict};
use iplw::inference::{DiagnosisConfig, diagnose};
use iplw::progress::NoProgress;
use iplw::reality::{Trial, trials_from_csv, trials_to_csv};

use crate::cases;
use crate::worlds::camera::Camera;
use crate::worlds::law::{Law, Motion, State};
use crate::worlds::recorded::{self, Kind};
use crate::worlds::shared::SharedDirt;
use crate::worlds::{Force, floor, launches, scene};

/// Noise, m, and observations per second.
const NOISE: f64 = 1e-3;
const RATE: f64 = 60.0;

/// Quadratic drag of `k` per metre in free flight.
fn drag(k: f64) -> Law {
    let force: Force = Arc::new(|_, s| {
        let speed = s[2].hypot(s[3]);
        [-speed * s[2], -speed * s[3]]
    });
    Law { pushes: vec![(k, force)], ..Law::plain(0.0, 0.0) }
}

/// Throws in free flight, one by each law.
fn thrown(laws: &[Law], seed: u64) -> Vec<Trial> {
    let all = launches(laws.len(), seed);
    let starts: Vec<State> = all.iter().map(|([x, y, vx, vy], _)| [*x, *y, *vx, *vy, 0.0, 0.0]).collect();
    let row = |law: &Law, duration: f64| {
        let last = (law.clock * duration * RATE) as usize;
        (0..=last).map(|k| k as f64 / RATE).collect::<Vec<f64>>()
    };
    let times: Vec<Vec<f64>> = laws.iter().zip(&all).map(|(law, (_, d))| row(law, *d)).collect();
    let camera = Camera {
        motion: Motion::Flies,
        scene: &scene(),
        starts: &starts,
        times: &times,
        marked: false,
        seed,
    };
    camera.recorded(laws, NOISE)
}

/// Balls that bounce on a floor.
fn bounced(law: &Law, count: usize, seed: u64) -> Vec<Trial> {
    let speed = |i: usize| 0.4 + 2.0 * i as f64 / count as f64;
    let start = |i: usize| -> State { [0.0, 0.6 + 0.1 * i as f64, speed(i), 0.0, 0.0, 0.0] };
    let starts: Vec<State> = (0..count).map(start).collect();
    let times = vec![(0..90).map(|k| f64::from(k) / RATE).collect::<Vec<f64>>(); count];
    let camera = Camera {
        motion: Motion::Bounces,
        scene: &floor(),
        starts: &starts,
        times: &times,
        marked: false,
        seed,
    };
    camera.recorded(&vec![law.clone(); count], NOISE)
}

fn diagnosed(scene: &iplw::task::Scene, trials: &[Trial], seed: u64) -> Diagnosis {
    diagnose(scene, trials, &DiagnosisConfig::standard(seed), &NoProgress).unwrap().diagnosis
}

fn sets(d: &Diagnosis) -> Vec<Vec<&str>> {
    d.rivals.iter().map(|set| set.iter().map(String::as_str).collect()).collect()
}

/// In free flight a clock, a length scale and gravity are twins whatever the factor, also beside drag.
#[test]
fn wrong_clocks_and_scales_are_twins_of_gravity_at_every_size() {
    for (clock, scale) in [(4.0, 1.0), (0.5, 1.0), (1.0, 0.4)] {
        let law = Law { clock, scale, ..Law::plain(0.0, 0.0) };
        let d = diagnosed(&scene(), &thrown(&vec![law; 8], 31), 31);
        let mut found = sets(&d);
        found.sort();
        assert_eq!(d.verdict, Verdict::Ambiguous, "{clock} {scale}: {}", d.reason);
        assert_eq!(found, [["gravity_error"], ["position_scale"], ["time_scale"]], "{clock} {scale}");
    }
    let law = Law { scale: 2.54, ..drag(0.13) };
    let d = diagnosed(&scene(), &thrown(&vec![law; 10], 32), 32);
    assert!(sets(&d).contains(&vec!["position_scale", "quadratic_drag"]), "{}", d.reason);
}

/// Coffee filters have a drag of several per metre, far from the linear response at zero.
#[test]
fn strong_drag_is_named() {
    let d = diagnosed(&scene(), &thrown(&vec![drag(5.0); 8], 33), 33);
    assert_eq!((d.verdict, sets(&d)), (Verdict::Named, vec![vec!["quadratic_drag"]]), "{}", d.reason);
    let k = &d.effects[0].parameters[0];
    assert!((k.value - 5.0).abs() < 0.2, "{k:?}");
}

/// A drag coefficient that falls by two thirds at 4 m/s: neither drag of the library is the law, and none is named.
#[test]
fn a_drag_crisis_leaves_the_law_open() {
    let force: Force = Arc::new(|_, s| {
        let speed = s[2].hypot(s[3]);
        let k = 0.06 + 0.12 / (1.0 + libm::exp((speed - 4.0) / 0.4));
        [-k * speed * s[2], -k * speed * s[3]]
    });
    let law = Law { pushes: vec![(1.0, force)], ..Law::plain(0.0, 0.0) };
    let d = diagnosed(&scene(), &thrown(&vec![law; 20], 36), 36);
    assert_eq!(d.verdict, Verdict::Unknown, "{}", d.reason);
    assert!(d.reason.contains("law is open"), "{}", d.reason);
}

/// Balls that a hand holds for a quarter of a second before each throw.
#[test]
fn what_is_held_before_a_throw_is_no_effect() {
    let held = |trial: Trial| {
        let csv = trials_to_csv(&[trial]);
        let (head, rows) = csv.split_once('\n').unwrap();
        let columns: Vec<&str> = head.split(',').collect();
        let at = |name: &str| columns.iter().position(|c| *c == name).unwrap();
        let first: Vec<&str> = rows.lines().next().unwrap().split(',').collect();
        let mut out = format!("{head}\n");
        for k in 0..15 {
            let mut row: Vec<String> = first.iter().map(|c| (*c).to_string()).collect();
            row[at("t")] = (f64::from(k) / RATE).to_string();
            row[at("x")] =
                (first[at("x")].parse::<f64>().unwrap() + 1e-3 * libm::sin(f64::from(7 * k * k))).to_string();
            out += &format!("{}\n", row.join(","));
        }
        for line in rows.lines() {
            let mut row: Vec<String> = line.split(',').map(String::from).collect();
            row[at("t")] = (row[at("t")].parse::<f64>().unwrap() + 15.0 / RATE).to_string();
            out += &format!("{}\n", row.join(","));
        }
        trials_from_csv(&out, &scene()).unwrap().remove(0)
    };
    let trials: Vec<Trial> = thrown(&vec![drag(0.2); 8], 34).into_iter().map(held).collect();
    let d = diagnosed(&scene(), &trials, 34);
    assert_eq!((d.verdict, sets(&d)), (Verdict::Named, vec![vec!["quadratic_drag"]]), "{}", d.reason);
}

/// One file of eight runs at half speed: it is named by its identifier, and the others are judged without it.
#[test]
fn a_trial_of_another_kind_is_named() {
    let mut laws = vec![drag(0.13); 8];
    laws[4].clock = 2.0;
    let d = diagnosed(&scene(), &thrown(&laws, 35), 35);
    assert_eq!(d.odd_trials.iter().map(|o| o.trial).collect::<Vec<_>>(), [4], "{}", d.reason);
    assert_eq!((d.verdict, sets(&d)), (Verdict::Named, vec![vec!["quadratic_drag"]]), "{}", d.reason);
}

/// Friction at which every impact grips has no upper limit; restitution is found. A floor 3 mm off its height is no effect.
#[test]
fn gripping_friction_is_open_and_floors_may_be_off() {
    let law = Law { height: -3e-3, ..Law::plain(0.8, 0.6) };
    let d = diagnosed(&floor(), &bounced(&law, 8, 36), 36);
    assert_eq!(d.verdict, Verdict::None, "{}", d.reason);
    let of = |name: &str| d.calibrated.iter().find(|c| c.name == name).unwrap();
    assert!(of("restitution").identifiable && (of("restitution").value - 0.8).abs() < 0.02, "{d:?}");
    assert!(!of("friction").identifiable, "{:?}", of("friction"));
    let offset = &d.surface_offsets[0];
    assert!((offset.offset + 3e-3).abs() < 1e-3, "{offset:?}");
    assert!(d.reason.contains("from where the scene has \"floor\""), "{}", d.reason);
    let level = diagnosed(&floor(), &bounced(&Law::plain(0.8, 0.6), 8, 36), 36);
    assert!(level.surface_offsets.is_empty(), "{:?}", level.surface_offsets);
}

/// Errors that all trials share (stray forces, a lens, the camera's angle) are not named for themselves: where nothing is hidden nothing
/// is named, and every set that is reported holds the hidden effect, five times as large.
#[test]
fn shared_errors_are_not_named_and_hide_nothing() {
    let mut found = 0;
    let kinds = [
        (Kind::Nothing(Motion::Bounces), 42),
        (Kind::Single(1), 43),
        (Kind::Nothing(Motion::Flies), 41),
        (Kind::Single(5), 44),
        (Kind::Contact(0), 45),
    ];
    for (kind, seed) in kinds.into_iter().take(cases(2, 5)) {
        let world = recorded::with_dirt(kind, false, seed, Some(SharedDirt::draw(seed)));
        let d = diagnosed(&world.scene, &world.trials, seed);
        let named = matches!(d.verdict, Verdict::Named | Verdict::Ambiguous);
        let holds =
            |set: &Vec<&str>| world.right.iter().any(|truth| truth.iter().all(|effect| set.contains(effect)));
        let is_right = named && sets(&d).iter().all(holds);
        assert!(is_right || !named, "{kind:?}: {:?} for {:?}", sets(&d), world.right);
        found += usize::from(is_right);
    }
    assert!(found >= cases(1, 2), "{found} of {} hidden effects", cases(1, 3));
}
