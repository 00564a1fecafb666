//! `iplw run` and `iplw experiment`: experiments with baselines, as CSV files, plots, tables and reports.

mod args;
mod claims;
mod configuration;
mod estimate_table;
mod grounding;
mod grounding_report;
mod quickstart;
mod run_archive;
mod story_table;
mod strategies;
mod study;

pub use args::{ExperimentArgs, RunArgs};

use iplw::error::{Error, Result};
use iplw::task::{Family, families};

/// An experiment: a row of [`experiments`].
struct ExperimentEntry {
    name: &'static str,
    run: fn(&ExperimentArgs) -> Result<()>,
    /// Options specific to this experiment.
    options: &'static [&'static str],
}

/// All experiments; the comparison of strategies on a family has the family's name.
fn experiments() -> Vec<ExperimentEntry> {
    let row = |name, run, options| ExperimentEntry { name, run, options };
    let of = |family: &&'static Family| -> ExperimentEntry {
        let options = &["--trials", "--batches", "--rounds", "--real", "--strategies", "--with-drag"];
        row(family.name, study::strategies, options)
    };
    let mut all = vec![
        row("quickstart", quickstart::multi_seed, &[]),
        row("strategies", strategies::run, &[]),
        row("latents", study::latents, &["--trials", "--batches"]),
    ];
    all.extend(families().iter().map(of));
    all.push(row("policies", study::policies, &["--trials", "--batches"]));
    all.push(row(
        "grounding",
        grounding::run,
        &["--acquisition", "--estimators", "--real", "--effect", "--set"],
    ));
    all.push(row("harder", study::harder, &["--trials", "--batches", "--worlds"]));
    all
}

/// The requested experiment; an error for options that don't apply to it.
fn select(args: &ExperimentArgs) -> Result<ExperimentEntry> {
    let mut all = experiments();
    let heeding = |option: &str| -> Vec<&str> {
        all.iter().filter(|e| e.options.contains(&option)).map(|e| e.name).collect()
    };
    let given = [
        ("--trials", args.trials.map(|v| v.to_string())),
        ("--batches", args.batches.map(|v| v.to_string())),
        ("--rounds", args.rounds.as_ref().map(|v| format!("{v:?}"))),
        ("--strategies", args.strategies.as_ref().map(|v| v.join(","))),
        ("--with-drag", args.with_drag.then(|| "true".into())),
        ("--acquisition", args.acquisition.as_ref().map(|v| v.join(","))),
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
        if let Some(value) = value.filter(|_| !all[chosen].options.contains(&option)) {
            let allowed = format!("no value: this option applies to {}", heeding(option).join(", "));
            return Err(Error::input(option, value, allowed));
        }
    }
    Ok(all.swap_remove(chosen))
}

pub fn run(args: &RunArgs) -> Result<()> {
    quickstart::run(args)
}

pub fn experiment(args: &ExperimentArgs) -> Result<()> {
    if let Some(seeds) = args.seeds {
        iplw::error::check_range("--seeds", seeds as f64, 1.0, 1000.0)?;
    }
    (select(args)?.run)(args)
}
