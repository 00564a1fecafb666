//! Benchmark of the diagnosis on task worlds with a hidden effect, from random actions: counts how often the diagnosis is
//! correct.
//!
//! `cargo run --release --example hidden_tasks -- --seeds 3 --out tasks.md`: every family with every effect of [`HIDDEN`] and
//! without, three worlds each, with random effect sizes. See `--help` for all options. Each result is appended to a CSV file
//! next to the table, and an interrupted run resumes.

#[path = "../tests/discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

use std::collections::{BTreeMap, HashSet};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{CommandFactory as _, Parser};
use iplw::experiment::random_trials;
use iplw::inference::report::{Diagnosis, Verdict};
use iplw::inference::{DiagnosisConfig, diagnose};
use iplw::progress::NoProgress;
use iplw::reality::{HiddenConfig, HiddenWorld, standard, with_trial_settings};
use iplw::rng;
use iplw::task::scene::EffectTerm;
use iplw::task::{Split, collection, families, family, register_families, split};
use iplw::world::Engine;
use rand::RngExt;
use worlds::study::{sets, weighed};

/// An effect with its parameters, and the parameter with a random size.
type Row = (&'static str, &'static [(&'static str, f64)], &'static str);

/// Hidden effects at their central sizes: damping 0.8 as in the paper, a strong breeze, a ball that loses half its speed in
/// 25 m, carpet in the middle of the floor, and the largest decrease of restitution that still gives a rebound at 20 m/s.
const HIDDEN: [Row; 6] = [
    ("nothing", &[], ""),
    ("linear_drag", &[("c", 0.223_143_55)], "c"),
    ("wind", &[("ax", 1.0)], "ax"),
    ("quadratic_drag", &[("k", 0.028)], "k"),
    ("sticky_patch", &[("x_min", 14.0), ("x_max", 28.0), ("y_min", 0.0), ("y_max", 6.0), ("c", 2.0)], "c"),
    ("restitution_speed", &[("slope", 0.004)], "slope"),
];
/// Range of sizes, relative to the central one.
const RELATIVE_SIZES: [f64; 2] = [0.75, 1.33];

/// Benchmarks the diagnosis on task worlds with hidden effects
#[derive(Parser)]
struct Run {
    /// Number of worlds per row
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// First seed
    #[arg(long, default_value_t = 1)]
    first: u64,
    /// Number of interactions per world
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..))]
    trials: u64,
    /// Standard deviation of the measurement noise, m; if not 0, only positions and angles are observed
    #[arg(long, default_value_t = 0.0)]
    noise: f64,
    /// Engine of the real world
    #[arg(long, default_value = "auto", value_parser = ["auto", "rapier"])]
    engine: String,
    /// Only rows whose names begin with this text, for example `bowling/wind`
    #[arg(long, default_value = "")]
    only: String,
    /// Additional collections of families, for example `phyre` or `levels`
    #[arg(long, value_name = "NAME")]
    tasks: Option<String>,
    /// Print the comparison of each diagnosis
    #[arg(long)]
    show: bool,
    /// Output file of the table
    #[arg(long, default_value = "out/hidden_tasks.md")]
    out: PathBuf,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let Run { seeds, first, trials, noise, engine, only, tasks, show, out } = Run::parse();
    if let Some(name) = tasks {
        let known = collection(&name).ok_or_else(|| format!("--tasks: no collection is called {name}"))?;
        register_families(known.families()?)?;
    }
    let engine = if engine == "rapier" { Engine::Rapier } else { Engine::Auto };
    let rows = families().iter().flat_map(|f| HIDDEN.map(|row| format!("{}/{}", f.name, row.0)));
    let names: Vec<String> = rows.collect();
    if !names.iter().any(|n| n.starts_with(&only)) {
        let text =
            format!("--only: no row begins with `{only}`; allowed: the beginning of {}\n", names.join(", "));
        Run::command().error(clap::error::ErrorKind::InvalidValue, text).exit();
    }
    if let Some(folder) = out.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let log = out.with_extension("csv");
    let known = std::fs::read_to_string(&log).unwrap_or_default();
    let done: HashSet<&str> = known.lines().filter_map(|l| l.split(',').next()).collect();
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(&log)?;
    for seed in first..first + seeds {
        for task in families().iter().map(|f| f.name) {
            for row in &HIDDEN {
                let name = format!("{task}/{}", row.0);
                let key = format!("{name}/{seed}/{trials}/{noise}/{engine:?}");
                if done.contains(key.as_str()) || !name.starts_with(only.as_str()) {
                    continue;
                }
                let world = HiddenConfig { noise, engine, ..hidden(task, row, seed)? };
                let begun = Instant::now();
                let d = look(task, world.clone(), trials as usize, seed)?;
                if show {
                    weighed(&d);
                }
                let line = line(row, &world, &d, begun.elapsed().as_secs_f64());
                eprintln!("{key}: {line}");
                file.write_all(format!("{key},{line}\n").as_bytes())?;
            }
        }
    }
    drop(file);
    let table = table(&log)?;
    print!("{table}");
    std::fs::write(&out, table)?;
    Ok(())
}

/// A task's standard hidden world with its effects replaced by one of random size.
fn hidden(task: &str, (name, parameters, drawn): &Row, seed: u64) -> iplw::error::Result<HiddenConfig> {
    let share: f64 =
        rng::stream(rng::derive_seed(seed, task, 0), name).random_range(RELATIVE_SIZES[0]..RELATIVE_SIZES[1]);
    let value = |(p, v): &(&str, f64)| (p.to_string(), if p == drawn { v * share } else { *v });
    let term = || EffectTerm { name: name.to_string(), parameters: parameters.iter().map(value).collect() };
    let effects = if parameters.is_empty() { Vec::new() } else { vec![term()] };
    Ok(HiddenConfig { effects, seed, ..standard(family(task)?) })
}

/// Diagnosis of random attempts at a family's training tasks.
fn look(task: &str, world: HiddenConfig, trials: usize, seed: u64) -> iplw::error::Result<Diagnosis> {
    let mut world = HiddenWorld::new(world)?;
    let tasks = split(&family(task)?.fold(0), Split::Train);
    let trials = random_trials(&tasks, &mut world, trials, seed, &NoProgress)?;
    let (scene, trials) = with_trial_settings(&tasks[0].scene, trials)?;
    Ok(diagnose(&scene, &trials, &DiagnosisConfig::standard(seed), &NoProgress)?.diagnosis)
}

/// Columns: verdict, sets, relative error of the random parameter, errors of friction and restitution, unexplained share,
/// seconds
fn line((name, _, drawn): &Row, world: &HiddenConfig, d: &Diagnosis, seconds: f64) -> String {
    let sets = sets(d);
    let parameter = |terms: &EffectTerm| terms.parameters.get(*drawn).copied();
    let truth = world.effects.first().and_then(parameter);
    let found = d.effects.iter().find(|e| e.name == *name);
    let found = found.and_then(|e| e.parameters.iter().find(|p| p.name == *drawn)).map(|p| p.value);
    let error = truth.zip(found).map_or(String::new(), |(t, f)| format!("{:.4}", f / t - 1.0));
    let latent = |name: &str, truth: Option<f64>| {
        let found = d.calibrated.iter().find(|c| c.name == name).map(|c| c.value);
        truth.zip(found).map_or(String::new(), |(t, f)| format!("{:.4}", f - t))
    };
    let friction = latent("friction", world.latents.friction);
    let restitution = latent("restitution", world.latents.restitution);
    let left = d.unexplained_share.map_or(String::new(), |s| format!("{s:.4}"));
    format!("{:?},{sets},{error},{friction},{restitution},{left},{seconds:.0}", d.verdict)
}

/// Success rates by row, and a list of all worlds.
fn table(log: &Path) -> std::io::Result<String> {
    let text = std::fs::read_to_string(log)?;
    // worlds, named alone, in the reported set, a wrong single name
    let mut counts: BTreeMap<String, [usize; 4]> = BTreeMap::new();
    let mut rows = String::new();
    for row in text.lines() {
        let cells: Vec<&str> = row.split(',').collect();
        let [key, verdict, sets, error, friction, restitution, left, seconds] = cells[..] else { continue };
        let parts: Vec<&str> = key.split('/').collect();
        let [task, truth, seed, trials, noise, engine] = parts[..] else { continue };
        let nothing = truth == "nothing";
        let named = verdict == format!("{:?}", Verdict::Named);
        let within = if nothing {
            verdict == format!("{:?}", Verdict::None)
        } else {
            sets.split('|').any(|s| s == truth) && verdict != format!("{:?}", Verdict::Unknown)
        };
        for of in
            [format!("{task} {truth}"), format!("all with {}", if nothing { "nothing" } else { "an effect" })]
        {
            let own = counts.entry(format!("{of} | {trials} | {noise} | {engine}")).or_default();
            let told = [true, within && (named || nothing), within, named && !within];
            own.iter_mut().zip(told).for_each(|(n, t)| *n += usize::from(t));
        }
        let _ = writeln!(
            rows,
            "| {task} | {truth} | {seed} | {trials} | {noise} | {engine} | {verdict} | {} | {error} | {friction} | {restitution} \
             | {left} | {seconds} |",
            sets.replace('|', " or ")
        );
    }
    let mut out = String::from(
        "| hidden | trials | noise, m | nature | worlds | named alone | in the reported set | a wrong single name |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for (of, [worlds, alone, within, wrong]) in counts {
        let _ = writeln!(out, "| {of} | {worlds} | {alone} | {within} | {wrong} |");
    }
    out += "\nParameter: relative error of the effect's size. Friction, restitution: found less true.\n\n\
            | task | hidden | seed | trials | noise, m | nature | verdict | reported | parameter | friction | restitution | \
            unexplained | s |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
    Ok(out + &rows)
}
