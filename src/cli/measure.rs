//! `iplw measure`: measurement of trials in a hidden world.

use std::path::{Path, PathBuf};

use iplw::design::{DESIGN_FORMAT, DesignDocument, ExperimentRow, training_and_test_tasks};
use iplw::error::{Error, Result, check_format};
use iplw::reality::{HiddenWorld, Reality, Trial, trials_to_csv, with_trial_settings};
use iplw::task::{Placement, Scene, Task, ValidAction};

use super::{output, parse};

/// Measure trials in a hidden world; writes scene.json and trials.csv.
///
/// Executes random actions on training tasks, or the experiments of a design, in a hidden world and records the trajectories. scene.json is
/// the simulation's scene, with nominal latents and without the hidden effects. Every trial is its own setting, since bodies are placed
/// differently.
#[derive(clap::Args)]
pub struct Args {
    /// Family, or a task such as bowling:017.
    #[arg(long)]
    task: String,
    /// Effect added to those of the hidden world, name:parameter=value,..; may be repeated; replaces one of the same name
    #[arg(long = "effect", value_name = "EFFECT")]
    effects: Vec<String>,
    /// Hidden world: damping=0.8,density=..,friction=..,restitution=..,engine=..,seed=.. [default: the family's]
    #[arg(long, default_value = "")]
    real: String,
    /// Number of random trials.
    #[arg(long, default_value_t = 50, conflicts_with = "design")]
    trials: usize,
    /// design.json of `iplw design`, whose experiments replace random actions [default: none]
    #[arg(long, value_name = "FILE")]
    design: Option<PathBuf>,
    /// Standard deviation of position noise, m.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    noise: f64,
    /// Random seed of actions and noise.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Output directory for scene.json and trials.csv.
    #[arg(long)]
    out: PathBuf,
}

pub fn run(args: &Args) -> Result<()> {
    iplw::error::check_range("--trials", args.trials as f64, 1.0, 100_000.0)?;
    let (tasks, family) = parse::tasks(&args.task)?;
    let mut config = parse::hidden(&args.effects, &args.real, family)?;
    (config.noise, config.seed) = (args.noise, args.seed);
    let mut world = HiddenWorld::new(config)?;
    let (training, _) = training_and_test_tasks(&tasks);
    if training.is_empty() {
        return Err(Error::input("--task", format!("{:?}", args.task), "a family with certified tasks"));
    }
    output::prepare_directory("--out", &args.out)?;
    let bar = output::TerminalProgress::new();
    let trials = match &args.design {
        Some(path) => measure_design(path, &training, &mut world)?,
        None => iplw::experiment::random_trials(&training, &mut world, args.trials, args.seed, &bar)?,
    };
    bar.clear();
    let count = trials.len();
    write_trials(&args.out, &training[0].scene, trials)?;
    eprintln!(
        "{count} trials ({} real interactions) in {}",
        world.interactions(),
        args.out.join("trials.csv").display()
    );
    Ok(())
}

/// Writes scene.json, the common `scene` with one setting per trial, and trials.csv.
pub fn write_trials(out: &Path, scene: &Scene, trials: Vec<Trial>) -> Result<()> {
    let (scene, named) = with_trial_settings(scene, trials)?;
    output::write_whole(&out.join("trials.csv"), trials_to_csv(&named).as_bytes())?;
    output::write_whole(&out.join("scene.json"), (scene.to_json() + "\n").as_bytes())
}

/// Executes the experiments of a design.
fn measure_design(path: &Path, tasks: &[Task], world: &mut HiddenWorld) -> Result<Vec<Trial>> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    measure_experiments(&text, tasks, world).map_err(|e| e.in_file(path.display()))
}

fn measure_experiments(design: &str, tasks: &[Task], world: &mut HiddenWorld) -> Result<Vec<Trial>> {
    let design: DesignDocument = iplw::json::parse(design)?;
    check_format(&design.format, DESIGN_FORMAT)?;
    if design.experiments.is_empty() {
        return Err(Error::input("experiments", "none", "at least one"));
    }
    // All experiments are checked before the first one is executed.
    let checked = |(i, experiment): (usize, &ExperimentRow)| -> Result<(&Task, ValidAction)> {
        let place = format!("experiments[{i}]");
        let task = tasks.iter().find(|t| t.id == experiment.task).ok_or_else(|| {
            let allowed = "a training task of --task";
            Error::input(format!("{place}.task"), format!("{:?}", experiment.task), allowed)
        })?;
        let action = task.actions().validate(&experiment.action).map_err(|e| e.in_field(&place))?;
        match task.place(&action) {
            Placement::Valid(_) => Ok((task, action)),
            Placement::Invalid(reason) => {
                let allowed = "an action that can be placed";
                Err(Error::input(format!("{place}.action"), reason, allowed))
            }
        }
    };
    let experiments = design.experiments.iter().enumerate().map(checked).collect::<Result<Vec<_>>>()?;
    let mut trials = Vec::with_capacity(experiments.len());
    for (task, action) in experiments {
        for attempt in world.measure(task, &[action])? {
            trials.extend(attempt.into_trial(format!("{}/{}", task.id, trials.len())));
        }
    }
    Ok(trials)
}
