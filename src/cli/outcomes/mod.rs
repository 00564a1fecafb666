//! `iplw outcomes`: outcomes of many actions in every task of a family, as NumPy arrays.

mod reader;
mod writer;

use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use iplw::policy::outcomes::{INVALID, OutcomesConfig, SOLVED, UNSOLVED, outcomes, select_action_indices};
use iplw::progress::Progress;
use iplw::reality::standard;
use iplw::task::{DEFAULT_FAMILY, Family, Task, ValidAction, split};
use iplw::world::{Engine, Latents};
use serde_json::json;

pub use reader::{FORMAT, OutcomesTable, read_all};
use writer::TableWriter;

use super::arrays::npy::{F64, npy};
use super::{output, parse};

/// Compute the outcomes of many actions in every task of a family; writes NumPy arrays.
///
/// Computes the outcomes of many actions in every task of a family, for training and evaluating agents without a simulator.
///
/// Writes actions.npy (float64: actions by components, each in [0, 1]), outcomes.npy (int8: tasks by actions; 1 solved, -1 not solved,
/// 0 invalid) and outcomes.json (tasks, physics and version). An interrupted run resumes. In Python: `iplw.Outcomes("outcomes")`.
#[derive(clap::Args)]
pub struct Args {
    /// Family, or one of its tasks.
    #[arg(long, default_value = DEFAULT_FAMILY)]
    task: String,
    /// Split: train, validation or test [default: all tasks]
    #[arg(long)]
    split: Option<String>,
    /// Number of discrete actions: a random subset if the family has more.
    #[arg(long, default_value_t = 100_000)]
    actions: usize,
    /// World: sim (the scene's physics) or real (with the family's hidden physics).
    #[arg(long, default_value = "sim")]
    world: String,
    /// Latents: density=..,friction=..,restitution=.. [default: the world's]
    #[arg(long, default_value = "")]
    latents: String,
    /// Additional effect, name:parameter=value,..; may be repeated.
    #[arg(long = "effect", value_name = "EFFECT")]
    effects: Vec<String>,
    /// Physics engine: auto, rapier, lanes or gpu.
    #[arg(long, default_value = "auto")]
    engine: String,
    /// Random seed of the subset of actions.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Output directory.
    #[arg(long, default_value = "outcomes")]
    out: PathBuf,
}

pub fn run(args: &Args) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.task)?;
    let tasks = match &args.split {
        None => tasks,
        Some(name) => split(&tasks, parse::part(name)?),
    };
    let Some(first) = tasks.first() else {
        return Err(Error::input("--split", format!("{:?}", args.split), "a part that has tasks"));
    };
    let given = OutcomesConfig {
        latents: parse::latents(&args.latents)?,
        effects: parse::effects(&args.effects)?,
        engine: Engine::from_name(&args.engine)?,
    };
    let config = world_physics(&args.world, family, &given)?;
    iplw::error::check_range("--actions", args.actions as f64, 1.0, 1e6)?;
    let numbers = select_action_indices(first.actions(), args.actions, args.seed)?;
    let actions: Vec<ValidAction> = numbers.iter().map(|i| first.actions().at(*i)).collect::<Result<_>>()?;
    output::prepare_directory("--out", &args.out)?;
    let of = json!({
        "format": FORMAT, "version": env!("CARGO_PKG_VERSION"), "family": family.name, "digest": family.digest,
        // The hidden physics isn't written; the family's digest covers it.
        "world": args.world, "latents": given.latents, "effects": given.effects, "engine": given.engine,
        "actions": actions.len(), "seed": args.seed, "codes": {"solved": SOLVED, "unsolved": UNSOLVED, "invalid": INVALID},
        "tasks": tasks.iter().map(|t| json!({"id": t.id, "split": t.split.name(), "scene": reader::scene_digest(t)})).collect::<Vec<_>>(),
    });
    let mut table = TableWriter::open(&args.out, &of, [tasks.len(), actions.len()])?;
    let values: Vec<u8> =
        actions.iter().flat_map(|a| a.values().iter().flat_map(|v| v.to_le_bytes())).collect();
    let shape = [actions.len(), first.actions().dimension()];
    output::write_whole(&args.out.join("actions.npy"), &npy(F64, &shape, &values))?;
    fill(&mut table, &tasks, &actions, &config)?;
    let found = table.finish([tasks.len(), actions.len()])?;
    output::print(&summary(&tasks, &found, actions.len(), &args.out))
}

/// The physics of a world with the user's latents and effects.
fn world_physics(world: &str, family: &Family, given: &OutcomesConfig) -> Result<OutcomesConfig> {
    if world == "sim" {
        return Ok(given.clone());
    }
    if world != "real" {
        return Err(Error::input("--world", format!("{world:?}"), "sim, real"));
    }
    let real = standard(family);
    let (own, over) = (real.latents, given.latents);
    let latents = Latents {
        density: over.density.or(own.density),
        friction: over.friction.or(own.friction),
        restitution: over.restitution.or(own.restitution),
    };
    let effects = real.effects.into_iter().chain(given.effects.clone()).collect();
    Ok(OutcomesConfig { latents, effects, engine: given.engine })
}

fn fill(
    table: &mut TableWriter,
    tasks: &[Task],
    actions: &[ValidAction],
    config: &OutcomesConfig,
) -> Result<()> {
    let bar = output::TerminalProgress::new();
    let total = (tasks.len() * actions.len()) as u64;
    for (t, task) in tasks.iter().enumerate().skip(table.rows) {
        let before = (t * actions.len()) as u64;
        let mut look = |done: usize| bar.report("outcomes", before + done as u64, total);
        table.add(&outcomes(task, actions, config, &mut look)?)?;
    }
    bar.clear();
    Ok(())
}

fn summary(tasks: &[Task], found: &[u8], actions: usize, out: &Path) -> String {
    let count = |row: &[u8], code: i8| row.iter().filter(|o| **o == code as u8).count();
    let rows = || found.chunks_exact(actions);
    let shares: Vec<f64> = rows()
        .map(|row| count(row, SOLVED) as f64 / (row.len() - count(row, INVALID)).max(1) as f64)
        .collect();
    let never = shares.iter().filter(|share| **share == 0.0).count();
    format!(
        "{} tasks, {actions} actions each: {:.1} % are invalid; {:.2} % of the others solve their task ({:.2} to {:.2} % by task); {never} tasks are solved by none\ntable: {}\n",
        tasks.len(),
        100.0 * count(found, INVALID) as f64 / found.len() as f64,
        100.0 * shares.iter().sum::<f64>() / shares.len() as f64,
        100.0 * shares.iter().copied().fold(f64::INFINITY, f64::min),
        100.0 * shares.iter().copied().fold(0.0, f64::max),
        out.display()
    )
}
