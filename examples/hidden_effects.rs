//! Hides effects in worlds of its own making, has them diagnosed, and counts how often the diagnosis is right.
//!
//! `cargo run --release --example hidden_effects -- --worlds 400 --out rates.md`: that many worlds of all kinds, and as
//! many again with nothing hidden. `--seed` draws other worlds. Each world's outcome is added to `worlds.csv` beside
//! the table as soon as it is known, and a run that was stopped goes on where it was.

#[path = "../tests/discover_worlds/mod.rs"]
mod worlds;

use std::collections::{BTreeMap, HashSet};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use iplw::discover::report::{Diagnosis, Verdict};
use iplw::discover::{Config, diagnose};
use iplw::progress::Silent;
use iplw::reality::Trial;
use iplw::rng;
use iplw::task::Scene;
use worlds::NOISES;

/// One world: what is hidden in it, what a diagnosis is given.
struct World {
    kind: String,
    names: Vec<&'static str>,
    parameter: Option<(&'static str, &'static str, f64)>,
    scene: Scene,
    trials: Vec<Trial>,
}

/// Trials, observations a trial, and path shifts in noise deviations: a medium effect, and a large one for forces that
/// no library holds (a force whose path cannot be told from a library's cannot be called unknown).
const TRIALS: usize = 14;
const ROWS: usize = 40;
const MEDIUM: f64 = 5.0;
const LARGE: f64 = 15.0;
/// Kinds of worlds with something hidden.
const KINDS: usize = worlds::SINGLES + 5 + 4 + 4 + worlds::CONTACTS;

fn main() -> std::io::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let given = |name: &str| {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|i| arguments.get(i + 1)).cloned()
    };
    let number = |name: &str, usual: u64| given(name).and_then(|v| v.parse().ok()).unwrap_or(usual);
    let (count, seed) = (number("--worlds", 28), number("--seed", 1));
    let out = PathBuf::from(given("--out").unwrap_or_else(|| "hidden_effects.md".into()));
    let log = out.with_file_name("worlds.csv");
    let known = std::fs::read_to_string(&log).unwrap_or_default();
    let done: HashSet<String> =
        known.lines().filter_map(|l| Some(l.split_once(',')?.0.to_string())).collect();
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(&log)?;
    let begun = std::time::Instant::now();
    for i in 0..2 * count {
        let id = format!("{seed}/{i}");
        if done.contains(&id) {
            continue;
        }
        let world = world(i, seed);
        let from = std::time::Instant::now();
        let d = match diagnose(&world.scene, &world.trials, &Config::standard(i), &Silent) {
            Ok(found) => found.diagnosis,
            Err(e) => panic!("world {id} could not be diagnosed: {e}"),
        };
        writeln!(file, "{id},{}", line(&world, &d, from.elapsed().as_secs_f64()))?;
        if i % 20 == 19 {
            eprintln!("{} of {} worlds, {:.0} s", i + 1, 2 * count, begun.elapsed().as_secs_f64());
        }
    }
    let table = table(&log)?;
    std::fs::write(&out, &table)?;
    print!("{table}");
    Ok(())
}

/// World number `i`: with something hidden, kind after kind, if it is even; with nothing if it is odd.
fn world(i: u64, seed: u64) -> World {
    let own = rng::derive(seed, "world", i);
    let (nothing, i) = (i % 2 == 1, i / 2);
    let round = (i / KINDS as u64) as usize;
    let noise = NOISES[(round + i as usize % KINDS) % 4];
    let fly = |kind: String, hidden: worlds::Hidden, noise, shift: f64| {
        let trials = worlds::trials(&hidden, noise, TRIALS, ROWS, shift, own);
        World { kind, names: hidden.names, parameter: hidden.parameter, scene: worlds::scene(), trials }
    };
    if nothing {
        let noise = NOISES[i as usize % 4];
        return fly(format!("nothing, {noise:?} noise"), worlds::nothing(), noise, MEDIUM);
    }
    let kind = i as usize % KINDS;
    if kind < worlds::SINGLES {
        return fly("single".into(), worlds::single(kind, own), noise, MEDIUM);
    }
    let kind = kind - worlds::SINGLES;
    if kind < 5 {
        return fly("double".into(), worlds::double(kind, own), noise, MEDIUM);
    }
    let kind = kind - 5;
    if kind < 4 {
        return fly("outside, medium".into(), worlds::outside(kind, own), noise, MEDIUM);
    }
    let kind = kind - 4;
    if kind < 4 {
        return fly("outside, large".into(), worlds::outside(kind, own), noise, LARGE);
    }
    let (names, trials) = worlds::contact(kind - 4, noise, TRIALS, 60, own);
    let kind = if names.is_empty() { "nothing, bouncing or rolling" } else { "contact" };
    World { kind: kind.into(), names, parameter: None, scene: worlds::floor(), trials }
}

/// kind, truth, verdict, sets, error, covered, share removed, seconds
fn line(world: &World, d: &Diagnosis, seconds: f64) -> String {
    let sets: Vec<String> = d.rivals.iter().map(|r| r.join("+")).collect();
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
    format!("{kind},{truth},{verdict},{},{error},{covered},{removed},{seconds:.2}", sets.join("|"))
}

/// Gravity too weak or strong, a wrong scale and a clock that runs at a wrong rate look exactly alike where starts are
/// free.
const TWINS: [&str; 3] = ["gravity_error", "position_scale", "time_scale"];

fn table(log: &Path) -> std::io::Result<String> {
    let text = std::fs::read_to_string(log)?;
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
            k if k.starts_with("outside") => {
                count(format!("{k}: unknown"), verdict == "Unknown");
                count(format!("{k}: confidently named"), named);
            }
            k => {
                count(format!("{k}: detected"), verdict != "None" && verdict != "InsufficientData");
                count(format!("{k}: truth in the reported set"), within);
                count(format!("{k}: right single name"), within && named);
                if !TWINS.iter().any(|t| truth.contains(t)) {
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
    let mut out = String::from("| figure | seen | worlds |\n|---|---|---|\n");
    for (name, [right, all]) in &counts {
        let share = 100.0 * *right as f64 / (*all).max(1) as f64;
        let _ = writeln!(out, "| {name} | {share:.1} % | {right} of {all} |");
    }
    let middle = |v: &mut Vec<f64>| {
        v.sort_by(f64::total_cmp);
        v.get(v.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let (n, m) = (errors.len(), removed.len());
    let _ = writeln!(out, "| parameter error, median | {:.1} % | {n} |", 100.0 * middle(&mut errors));
    let _ =
        writeln!(out, "| held-out excess removed, median | {:.1} % | {m} |", 100.0 * middle(&mut removed));
    let _ = writeln!(out, "| one diagnosis, median | {:.2} s | {} |", middle(&mut seconds), seconds.len());
    out += "\n| hidden | diagnosed | worlds |\n|---|---|---|\n";
    for ((hidden, found), number) in &matrix {
        let _ = writeln!(out, "| {hidden} | {found} | {number} |");
    }
    Ok(out)
}
