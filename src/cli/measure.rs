//! `iplw measure`: trials from a hidden world, as files.

use std::path::PathBuf;

use iplw::error::Result;
use iplw::reality::{HiddenWorld, Reality, settled, standard, trials_to_csv};
use iplw::task::{Split, split};

use super::{output, parse};

/// Random actions on the task's training part are carried out in a hidden world and observed. The scene that is
/// written is the simulation's: nominal latents, none of the hidden effects. Each trial is a setting of its own,
/// since what is placed differs between trials.
#[derive(clap::Args)]
pub struct Args {
    /// A family, or one task such as bowling:017.
    #[arg(long)]
    task: String,
    /// Effect of the hidden world, `name:parameter=value,...` (see `iplw effects`); may be repeated. None: the family's
    /// own.
    #[arg(long = "effect", value_name = "EFFECT")]
    effects: Vec<String>,
    /// More of the hidden world: `damping=0.8,density=..,friction=..,restitution=..,engine=..`.
    #[arg(long, default_value = "")]
    real: String,
    /// Number of trials.
    #[arg(long, default_value_t = 50)]
    trials: usize,
    /// Standard deviation of position noise, m.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    noise: f64,
    /// Seed of actions and noise.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Directory for scene.json and trials.csv.
    #[arg(long)]
    out: PathBuf,
}

pub fn run(args: &Args) -> Result<()> {
    iplw::error::within("--trials", args.trials as f64, 1.0, 100_000.0)?;
    let (tasks, family) = parse::tasks(&args.task)?;
    let mut config = standard(family);
    if !args.effects.is_empty() {
        config.effects = args.effects.iter().map(|e| parse::effect(e)).collect::<Result<_>>()?;
    }
    config = parse::real(&args.real, config)?;
    (config.noise, config.seed) = (args.noise, args.seed);
    let mut world = HiddenWorld::new(config)?;
    let training = if tasks.len() > 1 { split(&tasks, Split::Train) } else { tasks };
    output::directory("--out", &args.out)?;
    let bar = output::Bar::new();
    let trials = iplw::experiment::random_trials(&training, &mut world, args.trials, args.seed, &bar)?;
    bar.clear();
    let (scene, named) = settled(&training[0].scene, trials)?;
    output::write_whole(&args.out.join("trials.csv"), trials_to_csv(&named).as_bytes())?;
    output::write_whole(&args.out.join("scene.json"), (scene.to_json() + "\n").as_bytes())?;
    eprintln!(
        "{} trials ({} real interactions) in {}",
        named.len(),
        world.interactions(),
        args.out.join("trials.csv").display()
    );
    Ok(())
}
