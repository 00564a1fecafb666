//! `iplw run` and `iplw experiment`: figures with their baselines, as CSV, plot, table and report.

mod cells;
mod quickstart;
mod strategies;
mod study;

use std::path::PathBuf;
use std::sync::Arc;

use iplw::error::{Error, Result};
use iplw::experiment::statistics::Claim;
use iplw::experiment::surface;
use iplw::explore::Importance;
use iplw::picture::Block;
use iplw::task::Family;

use super::output;

/// The story: a hidden world, its latents estimated, a policy trained in the grounded simulation and tried on
/// unseen tasks of the hidden world, beside its baselines. Writes report.html, data as CSV and JSON, plots.
#[derive(clap::Args)]
pub struct RunArgs {
    /// bowling or basketball.
    #[arg(long, default_value = "bowling")]
    task: String,
    /// Seed of everything random.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Directory for the report and its data.
    #[arg(long, default_value = "out/quickstart")]
    out: PathBuf,
    /// A small run for a look: fewer labels, fewer candidates.
    #[arg(long)]
    quick: bool,
}

/// Experiments; one that was stopped goes on where it was when it is run again.
///
/// `quickstart`: the story over several seeds. `strategies`: every way of choosing actions, error of the latents
/// against real interactions. `latents`: policies from latents estimated on 10,000 random real trajectories beside
/// every baseline, learning on in the real world. `bowling`, `basketball`: jump start of every strategy over 10
/// rounds of 50 interactions. `harder`: real worlds with wind, quadratic drag, a sticky patch, another engine.
#[derive(clap::Args)]
pub struct ExperimentArgs {
    /// quickstart, strategies, latents, bowling, basketball or harder
    name: String,
    /// bowling or basketball.
    #[arg(long, default_value = "bowling")]
    task: String,
    /// Number of seeds, the first of the experiment's own; the experiment's number if not given.
    #[arg(long)]
    seeds: Option<u64>,
    /// Learning trials for each estimate (`latents`, `bowling`, `basketball`, `harder`); 3 if not given.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1000))]
    trials: Option<u64>,
    /// Rounds after which policies are trained, `1,3` (`bowling`, `basketball`), and the last; all if not given.
    #[arg(long, value_delimiter = ',')]
    rounds: Option<Vec<usize>>,
    /// Batches that policies are trained for in simulation (`latents`, `bowling`, `basketball`, `harder`); the paper's
    /// 1000 if not given.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    batches: Option<u64>,
    /// Of `harder`: some of its real worlds, `wind,quadratic_drag,sticky_patch,other_engine`; all if not given.
    #[arg(long, value_delimiter = ',')]
    worlds: Option<Vec<String>>,
    /// Of `strategies`: the hidden worlds, damped, no-drag or both.
    #[arg(long, default_value = "both")]
    hidden: String,
    /// Directory for the report and its data.
    #[arg(long)]
    out: PathBuf,
    /// A small run for a look.
    #[arg(long)]
    quick: bool,
}

/// All experiments.
const EXPERIMENTS: [&str; 6] = ["quickstart", "strategies", "latents", "bowling", "basketball", "harder"];

impl ExperimentArgs {
    /// Errors for an option that the experiment would not heed.
    fn check_options(&self) -> Result<()> {
        let transfers = ["latents", "bowling", "basketball", "harder"];
        let several = ["bowling", "basketball"];
        let given = [
            ("--trials", self.trials.map(|v| v.to_string()), &transfers[..]),
            ("--batches", self.batches.map(|v| v.to_string()), &transfers[..]),
            ("--rounds", self.rounds.as_ref().map(|v| format!("{v:?}")), &several[..]),
            ("--worlds", self.worlds.as_ref().map(|v| v.join(",")), &["harder"][..]),
        ];
        for (name, value, heeding) in given {
            if let Some(value) = value.filter(|_| !heeding.contains(&self.name.as_str())) {
                let allowed = format!("absent: it is for {}", heeding.join(", "));
                return Err(Error::input(name, value, allowed));
            }
        }
        Ok(())
    }

    /// As many seeds as were asked for, an experiment's own first; its own if no number was.
    fn seeds(&self, own: &[u64]) -> Vec<u64> {
        let wanted = self.seeds.map_or(own.len(), |n| n as usize);
        (0..wanted).map(|i| own.get(i).copied().unwrap_or(2000 + i as u64)).collect()
    }
}

/// Claims for people, a line each.
fn claims_text(claims: &[Claim]) -> String {
    let line = |c: &Claim| format!("{:<15} {}: {}\n", c.verdict.title(), c.text, c.figure);
    format!("\nclaims\n{}", claims.iter().map(line).collect::<String>())
}

/// Claims as a table of a report.
fn claims_table(claims: &[Claim]) -> Block {
    Block::Table {
        columns: ["claim", "verdict", "figure"].map(String::from).to_vec(),
        rows: claims
            .iter()
            .map(|c| vec![c.text.clone(), c.verdict.title().into(), c.figure.clone()])
            .collect(),
        note: "Paired by seed; undecided where the 95 % interval of the difference holds zero.".into(),
    }
}

pub fn run(args: &RunArgs) -> Result<()> {
    quickstart::story(&args.task, vec![args.seed], args.quick, &args.out)
}

pub fn experiment(args: &ExperimentArgs) -> Result<()> {
    if let Some(seeds) = args.seeds {
        iplw::error::within("--seeds", seeds as f64, 1.0, 1000.0)?;
    }
    if !EXPERIMENTS.contains(&args.name.as_str()) {
        let known = EXPERIMENTS.map(String::from).to_vec();
        return Err(Error::NotFound { kind: "experiment", id: args.name.clone(), known });
    }
    args.check_options()?;
    match args.name.as_str() {
        "quickstart" => {
            quickstart::story(&args.task, (0..args.seeds.unwrap_or(3)).collect(), args.quick, &args.out)
        }
        "strategies" => strategies::run(args),
        _ => study::run(args),
    }
}

/// The performance surface that strategies need or use: one for all arms and seeds, found in related environments
/// before anything real is spent.
fn importance(family: &Family, needed: bool) -> Result<Option<Arc<dyn Importance>>> {
    if !needed {
        return Ok(None);
    }
    let bar = output::Bar::new();
    let found = surface::quick(family, &bar)?;
    bar.clear();
    Ok(Some(Arc::new(found)))
}
