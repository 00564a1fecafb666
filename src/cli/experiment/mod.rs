//! `iplw run` and `iplw experiment`: figures with their baselines, as CSV, plot, table and report.

mod args;
mod grounding;
mod grounding_rows;
mod quickstart;
mod shared;
mod shelf;
mod strategies;
mod study;

pub use args::{ExperimentArgs, RunArgs};

use iplw::error::{Error, Result};
use iplw::task::{Family, families};

/// An experiment: a row of [`experiments`].
struct Experiment {
    name: &'static str,
    run: fn(&ExperimentArgs) -> Result<()>,
    /// Options it heeds beyond those that all do.
    heeds: &'static [&'static str],
}

/// Every experiment; each family's comparison of strategies goes by the family's name.
fn experiments() -> Vec<Experiment> {
    let row = |name, run, heeds| Experiment { name, run, heeds };
    let of = |family: &&'static Family| -> Experiment {
        row(family.name, study::strategies, &["--trials", "--batches", "--rounds"])
    };
    let mut all = vec![
        row("quickstart", quickstart::several, &[]),
        row("strategies", strategies::run, &[]),
        row("latents", study::latents, &["--trials", "--batches"]),
    ];
    all.extend(families().iter().map(of));
    all.push(row("policies", study::policies, &["--trials", "--batches"]));
    all.push(row("grounding", grounding::run, &["--ways", "--estimators", "--real", "--effect", "--set"]));
    all.push(row("harder", study::harder, &["--trials", "--batches", "--worlds"]));
    all
}

/// The experiment that was named; an error for an option that it would not heed.
fn chosen(args: &ExperimentArgs) -> Result<Experiment> {
    let mut all = experiments();
    let heeding = |option: &str| -> Vec<&str> {
        all.iter().filter(|e| e.heeds.contains(&option)).map(|e| e.name).collect()
    };
    let given = [
        ("--trials", args.trials.map(|v| v.to_string())),
        ("--batches", args.batches.map(|v| v.to_string())),
        ("--rounds", args.rounds.as_ref().map(|v| format!("{v:?}"))),
        ("--ways", args.ways.as_ref().map(|v| v.join(","))),
        ("--estimators", args.estimators.as_ref().map(|v| v.join(","))),
        ("--real", args.real.clone()),
        ("--effect", Some(args.effects.join(" ")).filter(|e| !e.is_empty())),
        ("--set", args.set.clone()),
        ("--worlds", args.worlds.as_ref().map(|v| v.join(","))),
    ];
    let known = all.iter().map(|e| e.name.to_string()).collect();
    let Some(chosen) = all.iter().position(|e| e.name == args.name) else {
        return Err(Error::NotFound { kind: "experiment", id: args.name.clone(), known });
    };
    for (option, value) in given {
        if let Some(value) = value.filter(|_| !all[chosen].heeds.contains(&option)) {
            let allowed = format!("absent: it is for {}", heeding(option).join(", "));
            return Err(Error::input(option, value, allowed));
        }
    }
    Ok(all.swap_remove(chosen))
}

pub fn run(args: &RunArgs) -> Result<()> {
    quickstart::story(&args.task, vec![args.seed], args.quick, &args.out)
}

pub fn experiment(args: &ExperimentArgs) -> Result<()> {
    if let Some(seeds) = args.seeds {
        iplw::error::within("--seeds", seeds as f64, 1.0, 1000.0)?;
    }
    (chosen(args)?.run)(args)
}
