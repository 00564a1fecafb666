//! Benchmark of the diagnosis on synthetic worlds with hidden effects: counts how often the diagnosis is correct.
//!
//! `cargo run --release --example hidden_effects -- --worlds 400 --out rates.md`: 400 worlds of all kinds with effects, and as
//! many without. See `--help` for all options. Each result is appended to `worlds.csv` next to the table, and an interrupted
//! run resumes. `--export DIR` writes the worlds for other methods (`benches/other_diagnoses.py`).

#[path = "../tests/discover_worlds/mod.rs"]
mod worlds;

use std::collections::{BTreeMap, HashSet};
use std::fmt::Write as _;

use iplw::inference::report::{Diagnosis, Verdict};
use iplw::inference::{DiagnosisConfig, diagnose};
use iplw::progress::NoProgress;
use iplw::reality::Trial;
use iplw::rng;
use iplw::task::Scene;
use rand::RngExt;
use worlds::study::{Run, middle, rates, sets, weighed};
use worlds::{GRAVITY_TWINS, NOISES, Noise};

/// Sets of effects, with the indistinguishable twins of gravity identified.
fn apart(sets: &str) -> HashSet<String> {
    let plain = |set: &str| {
        let twin =
            |n: &str| if GRAVITY_TWINS.contains(&n) { "gravity_error".to_string() } else { n.to_string() };
        let mut names: Vec<String> = set.split('+').map(twin).collect();
        names.sort();
        names.join("+")
    };
    sets.split('|').filter(|s| !s.is_empty()).map(plain).collect()
}

/// Correct sets of a world: the hidden one first, then those that free flights cannot distinguish from it.
fn right(world: &World) -> Vec<Vec<&'static str>> {
    match world.names[..] {
        [] | ["outside"] => Vec::new(),
        _ if world.scene.statics.is_empty() => worlds::with_twins(&world.names),
        _ => vec![world.names.clone()],
    }
}

/// One world: hidden effects, and the input of its diagnosis.
#[derive(Clone)]
struct World {
    kind: String,
    names: Vec<&'static str>,
    parameter: Option<(&'static str, &'static str, f64)>,
    scene: Scene,
    trials: Vec<Trial>,
    /// World for further trials: the hidden force, the kind of measurement noise and its size, m.
    more: Option<(worlds::HiddenForce, Noise, f64)>,
}

/// Trials, observations per trial, and path shifts in standard deviations of the noise: a medium effect, and a large one for
/// forces outside the library (a force whose path is indistinguishable from a library effect's cannot be diagnosed as unknown).
const TRIALS: usize = 14;
const OBSERVATIONS: usize = 40;
const MEDIUM_SHIFT: f64 = 5.0;
const LARGE_SHIFT: f64 = 15.0;
/// Number of kinds of worlds with hidden effects.
const KINDS: usize = worlds::SINGLES + 2 * worlds::DOUBLES + 2 * worlds::OUTSIDE.len() + worlds::CONTACTS;

fn main() -> std::io::Result<()> {
    let run = Run::with("28", "out/hidden_effects.md");
    let log = run.log("worlds.csv", 2 * run.worlds, |i, id| {
        let world = world(i, run.seed);
        world.kind.contains(&run.only).then(|| study(&world, id, i, &run))
    })?;
    run.tell(&table(&log), wrong_names(&log))
}

/// Result row of a world, and one for each further round of advised trials.
fn study(world: &World, id: &str, seed: u64, run: &Run) -> String {
    run.export(id, &world.kind, &right(world), &world.scene, &world.trials)
        .expect("the world can be written");
    let look = |trials: &[Trial]| match diagnose(
        &world.scene,
        trials,
        &DiagnosisConfig::standard(seed),
        &NoProgress,
    ) {
        Ok(found) => found.diagnosis,
        Err(e) => panic!("world {id} could not be diagnosed: {e}"),
    };
    let from = std::time::Instant::now();
    let d = look(&world.trials);
    let mut out = format!("{id},{}\n", line(world, &d, from.elapsed().as_secs_f64()));
    let mut now = d.clone();
    let mut trials = world.trials.clone();
    for round in 1..=if run.once { 0 } else { 2 } {
        if now.verdict != Verdict::Ambiguous || apart(&sets(&now)).len() < 2 {
            break;
        }
        let own = World { trials: trials.clone(), ..world.clone() };
        let Some(all) = followed(&own, &now, rng::derive_seed(seed, "round", round)) else { break };
        let from = std::time::Instant::now();
        (now, trials) = (look(&all), all);
        let kind = format!("advice followed {round} / {}", world.kind);
        let own = World { kind, ..world.clone() };
        out += &format!("{id}/{round},{}\n", line(&own, &now, from.elapsed().as_secs_f64()));
    }
    if run.talk {
        eprint!("{out}");
        weighed(&d);
        if let Some(next) = &d.next_experiment {
            eprintln!("  {} ({})", next.action, next.why);
        }
        if let Some(r) = &d.remainder {
            eprintln!(
                "  unnamed force {:?} nats, explained {:?}",
                r.unnamed_force_evidence, r.explained_share
            );
        }
    }
    out
}

/// The trials together with those that a diagnosis recommends, if it recommends any.
fn followed(world: &World, d: &Diagnosis, seed: u64) -> Option<Vec<Trial>> {
    let (hidden, noise, sd) = world.more.as_ref()?;
    let scene = d.next_experiment.as_ref()?.scene.as_ref()?;
    let (at, v) = (scene.bodies[0].position?, scene.bodies[0].velocity);
    let duration = f64::from(scene.steps) * scene.time_step / 1.05;
    let mut r = rng::stream(seed, "advised launches");
    // Actuation noise.
    let mut about = |value: f64, error: f64| value + error * r.random_range(-1.0..1.0);
    let launches: Vec<worlds::Launch> = (0..6)
        .map(|_| {
            let speed = about(1.0, 0.05);
            let turn = about(0.0, 0.04);
            let start = [
                about(at[0], 0.05),
                about(at[1], 0.05),
                speed * (v[0] * turn.cos() - v[1] * turn.sin()),
                speed * (v[1] * turn.cos() + v[0] * turn.sin()),
            ];
            (start, duration)
        })
        .collect();
    let mut trials = world.trials.clone();
    trials.extend(worlds::thrown(
        hidden,
        *noise,
        &launches,
        OBSERVATIONS,
        *sd,
        rng::derive_seed(seed, "advised", 0),
    ));
    Some(trials)
}

/// World number `i`: with hidden effects, cycling through the kinds, if `i` is even; without if it is odd.
fn world(i: u64, seed: u64) -> World {
    let own = rng::derive_seed(seed, "world", i);
    let (nothing, i) = (i % 2 == 1, i / 2);
    let round = (i / KINDS as u64) as usize;
    let noise = NOISES[(round + i as usize % KINDS) % 4];
    let fly = |kind: String, hidden: worlds::HiddenForce, noise, shift: f64| {
        let trials = worlds::trials(&hidden, noise, TRIALS, OBSERVATIONS, shift, own);
        let sd = worlds::noise_sd(&hidden, TRIALS, OBSERVATIONS, shift, own);
        let (names, parameter) = (hidden.names.clone(), hidden.parameter);
        World { kind, names, parameter, scene: worlds::scene(), trials, more: Some((hidden, noise, sd)) }
    };
    if nothing {
        let noise = NOISES[i as usize % 4];
        return fly(format!("nothing, {noise:?} noise"), worlds::no_effect(), noise, MEDIUM_SHIFT);
    }
    let mut kind = i as usize % KINDS;
    let mut among = |count: usize| {
        let (within, own) = (kind < count, kind);
        kind = kind.wrapping_sub(count);
        within.then_some(own)
    };
    if let Some(k) = among(worlds::SINGLES) {
        return fly("single".into(), worlds::single(k, own), noise, MEDIUM_SHIFT);
    }
    if let Some(k) = among(worlds::DOUBLES) {
        return fly("double".into(), worlds::double(k, own), noise, MEDIUM_SHIFT);
    }
    if let Some(k) = among(worlds::DOUBLES) {
        return fly("uneven double".into(), worlds::unbalanced_double(k, own), noise, MEDIUM_SHIFT);
    }
    for (size, shift) in [("medium", MEDIUM_SHIFT), ("large", LARGE_SHIFT)] {
        if let Some(k) = among(worlds::OUTSIDE.len()) {
            let kind = format!("outside, {size}, {}", worlds::OUTSIDE[k]);
            return fly(kind, worlds::outside(k, own), noise, shift);
        }
    }
    let (names, trials) = worlds::contact(kind, noise, TRIALS, 60, own);
    let kind = if names.is_empty() { "nothing, bouncing or rolling" } else { "contact" };
    World { kind: kind.into(), names, parameter: None, scene: worlds::floor(), trials, more: None }
}

/// kind, truth, verdict, sets, error, covered, share removed, seconds
fn line(world: &World, d: &Diagnosis, seconds: f64) -> String {
    let mut truth = world.names.clone();
    truth.sort_unstable();
    let within = d.rivals.iter().any(|r| r.iter().map(String::as_str).eq(truth.iter().copied()));
    let named = within && d.verdict == Verdict::Named;
    let told = world.parameter.filter(|_| named).and_then(|(effect, name, value)| {
        let found = d.effects.iter().find(|e| e.name == effect)?;
        Some((found.parameters.iter().find(|p| p.name == name)?, value))
    });
    let error = told.map_or(String::new(), |(p, v)| format!("{:.4}", (p.value / v - 1.0).abs()));
    let covered = told.map_or(String::new(), |(p, v)| match p.ci95 {
        [Some(a), Some(b)] => u8::from(a <= v && v <= b).to_string(),
        _ => String::new(),
    });
    let removed = d.gain.held_out.as_ref().and_then(|g| g.excess_removed);
    let removed = removed.filter(|_| within).map_or(String::new(), |r| format!("{r:.3}"));
    let kind = world.kind.replace(", ", " / ");
    let (truth, verdict) = (truth.join("+"), format!("{:?}", d.verdict));
    format!("{kind},{truth},{verdict},{},{error},{covered},{removed},{seconds:.2}", sets(d))
}

/// Numbers of worlds with a wrong name, and of all; rounds of advice do not count.
fn wrong_names(text: &str) -> [usize; 2] {
    let mut out = [0, 0];
    for row in text.lines() {
        let cells: Vec<&str> = row.split(',').collect();
        let [_, kind, truth, verdict, sets, ..] = cells[..] else { continue };
        if !kind.starts_with("advice followed") {
            out[0] += usize::from(verdict == "Named" && sets != truth);
            out[1] += 1;
        }
    }
    out
}

fn table(text: &str) -> String {
    let mut counts: BTreeMap<String, [usize; 2]> = BTreeMap::new();
    let mut matrix: BTreeMap<(String, String), usize> = BTreeMap::new();
    let (mut errors, mut removed, mut seconds) = (Vec::new(), Vec::new(), Vec::new());
    for row in text.lines() {
        let cells: Vec<&str> = row.split(',').collect();
        let [_, kind, truth, verdict, sets, error, covered, gone, time] = cells[..] else { continue };
        let mut count = |name: String, right: bool| {
            let own = counts.entry(name).or_default();
            own[0] += usize::from(right);
            own[1] += 1;
        };
        let within = sets.split('|').any(|s| s == truth);
        let named = verdict == "Named";
        match kind {
            k if k.starts_with("nothing") => count(format!("false alarms, {k}"), verdict != "None"),
            k if k.starts_with("advice followed") => {
                let one = apart(sets).len() == 1 && verdict != "Unknown";
                let right = apart(sets) == apart(truth);
                let k = if k.starts_with("advice followed 1") { "once" } else { "twice" };
                let outside = truth == "outside";
                let which = if outside { " (outside the library)" } else { "" };
                count(format!("advice followed {k}{which}: one set left, the true one"), right && !outside);
                count(
                    format!("advice followed {k}{which}: one set left, a wrong one"),
                    one && (outside || !right),
                );
                count(
                    format!("advice followed {k}{which}: truth in the reported set"),
                    apart(truth).is_subset(&apart(sets)),
                );
                continue;
            }
            k if k.starts_with("outside") => {
                let all = k.rsplit_once(" / ").map_or(k, |(all, _)| all);
                for k in [all, k] {
                    count(format!("{k}: unknown"), verdict == "Unknown");
                    count(format!("{k}: confidently named"), named);
                }
            }
            k => {
                count(format!("{k}: detected"), verdict != "None" && verdict != "InsufficientData");
                count(format!("{k}: truth in the reported set"), within);
                count(format!("{k}: right single name"), within && named);
                if !GRAVITY_TWINS.iter().any(|t| truth.contains(t)) {
                    count(format!("{k}: right single name, twins of gravity left out"), within && named);
                }
                count(format!("{k}: confidently wrong"), named && !within);
                count(format!("{k} {truth}: right single name"), within && named);
                if let Ok(c) = covered.parse::<u8>() {
                    count("95 % intervals that hold the truth".into(), c == 1);
                    count(format!("95 % intervals that hold the truth, {truth}"), c == 1);
                }
            }
        }
        errors.extend(error.parse::<f64>());
        removed.extend(gone.parse::<f64>());
        seconds.extend(time.parse::<f64>());
        let hidden = if truth.is_empty() { kind } else { truth };
        let hidden = if kind.starts_with("outside") { kind } else { hidden };
        *matrix.entry((hidden.to_string(), format!("{verdict} {sets}").replace('|', " or "))).or_default() +=
            1;
    }
    let mut out = rates(counts.iter().map(|(name, count)| (name.as_str(), *count)));
    out += "\n| figure | seen | worlds |\n|---|---|---|\n";
    let (n, m) = (errors.len(), removed.len());
    let _ = writeln!(out, "| parameter error, median | {:.1} % | {n} |", 100.0 * middle(&mut errors));
    let _ =
        writeln!(out, "| held-out excess removed, median | {:.1} % | {m} |", 100.0 * middle(&mut removed));
    let _ = writeln!(out, "| one diagnosis, median | {:.2} s | {} |", middle(&mut seconds), seconds.len());
    out += "\n| hidden | diagnosed | worlds |\n|---|---|---|\n";
    for ((hidden, found), number) in &matrix {
        let _ = writeln!(out, "| {hidden} | {found} | {number} |");
    }
    out
}
