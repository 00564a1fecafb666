//! `iplw train` and `iplw evaluate`: a policy as a safetensors file, and how it does in a hidden world.

use std::path::PathBuf;
use std::time::Instant;

use iplw::error::{Error, Result};
use iplw::experiment::try_out;
use iplw::policy::{
    CHUNK, Dqn, EvaluateConfig, Evaluation, Judge, LabelConfig, Labelled, Lesson, Place, Saturation, Table,
    TrainConfig, TrainLog, Training, label, rank, train, train_saturated,
};
use iplw::progress::Progress;
use iplw::reality::standard;
use iplw::task::{DEFAULT_FAMILY, Labels, Learning, Split, Task, split};
use iplw::world::Engine;
use serde_json::json;

use super::outcomes::read_all;
use super::{output, parse};

/// Labels random actions of the training tasks in a simulation and trains a policy on them.
#[derive(clap::Args)]
pub struct TrainArgs {
    /// A family, or one of its tasks.
    #[arg(long, default_value = DEFAULT_FAMILY)]
    task: String,
    /// Latents of the simulation, `density=..,friction=..,restitution=..`; the scene's own where not given.
    #[arg(long, default_value = "")]
    latents: String,
    /// Train under domain randomisation over the paper's ranges instead of at `--latents`.
    #[arg(long, conflicts_with = "latents")]
    randomised: bool,
    /// Train under what is known: every action is labelled in a world drawn from a posterior (`iplw.posterior/1`), so that what
    /// works in most of them ranks high.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["latents", "randomised", "effects"])]
    belief: Option<PathBuf>,
    /// Effect of the simulation, `name:parameter=value,...`; may be repeated.
    #[arg(long = "effect", value_name = "EFFECT")]
    effects: Vec<String>,
    /// Learn from tables that `iplw outcomes` wrote, one a family, and from their training tasks: no simulator is asked. Of
    /// several families the policy becomes one for any that has the same kind of actions.
    #[arg(long, num_args = 1.., value_name = "DIR", conflicts_with_all = ["task", "latents", "randomised", "belief", "effects", "preset", "fold"])]
    outcomes: Vec<PathBuf>,
    /// Labelled actions per training task, and further ones of a task that few of them solve; the family's number if
    /// not given, with --outcomes the usual one of any family.
    #[arg(long)]
    per_task: Option<usize>,
    /// How long to train. `saturating`: stretches of the family's number of updates until AUCCESS on its validation tasks, tried
    /// in the simulation trained in, grows no more; the best weights are kept. `paper`: that number and no more. If not given,
    /// `saturating` for a family, `paper` for one task, with --batches and with --outcomes. `saturating` labels at least 1000
    /// actions a task and takes batches of at least 64, if nothing else is asked for.
    #[arg(long)]
    preset: Option<String>,
    /// Updates, as many as this: a fixed training, as with `--preset paper`.
    #[arg(long)]
    batches: Option<usize>,
    /// Examples per update, half of them solving; likewise.
    #[arg(long)]
    batch_size: Option<usize>,
    /// Deal the family's tasks anew to train, validation and test; 0 is how they are dealt if not given.
    #[arg(long)]
    fold: Option<u64>,
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// File for the weights (safetensors).
    #[arg(long, default_value = "policy.safetensors")]
    out: PathBuf,
}

/// Lets a policy rank the actions of each task and tries them in the hidden world, best first, up to 100.
#[derive(clap::Args)]
pub struct EvaluateArgs {
    /// A family, or one task such as bowling:017.
    #[arg(long, default_value = DEFAULT_FAMILY)]
    task: String,
    /// Try it in the world of tables that `iplw outcomes` wrote, instead: all their actions are ranked, no simulator is asked.
    #[arg(long, num_args = 1.., value_name = "DIR", conflicts_with_all = ["task", "real", "candidates"])]
    outcomes: Vec<PathBuf>,
    /// File of weights that `iplw train` wrote.
    #[arg(long)]
    policy: PathBuf,
    /// train, validation or test.
    #[arg(long, default_value = "test")]
    split: String,
    /// The fold that the policy was trained in, as `iplw train --fold` deals it.
    #[arg(long, conflicts_with = "outcomes")]
    fold: Option<u64>,
    /// The hidden world, over the family's own: `damping=0.8,density=..,friction=..,restitution=..`.
    #[arg(long, default_value = "")]
    real: String,
    /// Actions ranked per task.
    #[arg(long, default_value_t = 10_000)]
    candidates: usize,
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

pub fn train_policy(args: &TrainArgs) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.task)?;
    let tasks = parse::fold(tasks, family, args.fold)?;
    let saturating = saturating(args, &tasks)?;
    let usual = match args.outcomes.as_slice() {
        [] if saturating => family.learning.saturating(),
        [] => family.learning,
        _ => Learning::STANDARD,
    };
    let per_task = args.per_task.unwrap_or(usual.labels.per_task);
    iplw::error::within("--per-task", per_task as f64, 1.0, 50_000.0)?;
    let labels = Labels { per_task, ..usual.labels };
    let config = TrainConfig {
        batches: args.batches.unwrap_or(usual.batches),
        batch_size: args.batch_size.unwrap_or(usual.batch_size),
        seed: args.seed,
        ..TrainConfig::preset(&usual)
    };
    config.validate()?;
    output::file("--out", &args.out)?;
    if !args.outcomes.is_empty() {
        let tables: Vec<Table> =
            read_all("--outcomes", &args.outcomes)?.into_iter().map(|r| r.table).collect();
        let lesson = Lesson::new(&tables, &places(&tables, Split::Train)?, &labels, args.seed);
        let [solving, failing] = lesson.counts();
        return learn(args, &lesson, [solving + failing, solving], &config, None);
    }
    let training = training(args)?;
    let bar = output::Bar::new();
    let own = if tasks.len() > 1 { split(&tasks, Split::Train) } else { tasks.clone() };
    let data = label(&own, &training, &LabelConfig::preset(&labels, args.seed), &bar)?;
    bar.clear();
    let counts = [data.rows.len(), data.solving()];
    if !saturating {
        return learn(args, &data, counts, &config, None);
    }
    let until = Saturation::usual(&config);
    let judge = Judge::new(
        &split(&tasks, Split::Validation),
        training.worlds(until.worlds, args.seed),
        &EvaluateConfig::phyre(args.seed),
        Engine::Auto,
    )?;
    learn(args, &data, counts, &config, Some((&judge, &until)))
}

/// Whether to train for as long as it helps.
fn saturating(args: &TrainArgs, tasks: &[Task]) -> Result<bool> {
    let can = tasks.len() > 1 && tasks.iter().any(|t| t.split == Split::Validation);
    match args.preset.as_deref() {
        Some("paper") => Ok(false),
        None => Ok(can && args.batches.is_none() && args.outcomes.is_empty()),
        Some("saturating") if args.batches.is_some() => {
            Err(Error::input("--batches", "given beside --preset saturating", "one or the other"))
        }
        Some("saturating") if !can => {
            let allowed = "a family with validation tasks, which say when to stop";
            Err(Error::input("--task", format!("{:?} with --preset saturating", args.task), allowed))
        }
        Some("saturating") => Ok(true),
        Some(other) => Err(Error::input("--preset", format!("{other:?}"), "paper or saturating")),
    }
}

/// The physics that labels come from, as it was asked for.
fn training(args: &TrainArgs) -> Result<Training> {
    let effects = parse::effects(&args.effects)?;
    if let Some(path) = &args.belief {
        return Ok(Training::believed(&parse::belief(path)?));
    }
    if args.randomised {
        return Ok(Training::paper_randomised(effects));
    }
    Ok(Training::Fixed { latents: parse::latents(&args.latents)?, effects })
}

/// Trains on labelled actions, of which there are so many and so many that solve, and writes the weights; for as long as it
/// helps if there is somebody to judge it.
fn learn(
    args: &TrainArgs,
    data: &dyn Labelled,
    [all, solving]: [usize; 2],
    config: &TrainConfig,
    judged: Option<(&Judge, &Saturation)>,
) -> Result<()> {
    let (bar, started) = (output::Bar::new(), Instant::now());
    let (policy, log) = match judged {
        None => train(data, config, &bar)?,
        Some((judge, until)) => train_saturated(data, judge, config, until, &bar)?,
    };
    bar.clear();
    let weights = iplw::policy::Policy::to_safetensors(&policy)
        .ok_or_else(|| Error::Failed("the policy has no weights to write".into()))?;
    output::write_whole(&args.out, &weights)?;
    let tail = &log.loss[log.loss.len().saturating_sub(100)..];
    output::print(&format!(
        "{all} actions labelled ({solving} solve), {} batches in {:.1} s\nmean loss of the last {} batches: {:.3} nats\n{}weights: {}\n",
        log.loss.len(),
        started.elapsed().as_secs_f64(),
        tail.len(),
        tail.iter().sum::<f32>() / tail.len().max(1) as f32,
        looks(&policy, &log),
        args.out.display()
    ))
}

/// What validation said after every stretch, and which weights were kept.
fn looks(policy: &Dqn, log: &TrainLog) -> String {
    if log.validation.is_empty() {
        return String::new();
    }
    let kept = policy.card().batches();
    let told: Vec<String> =
        log.validation.iter().map(|c| format!("{:.3} after {}", c.auccess, c.batches)).collect();
    format!(
        "AUCCESS on the validation tasks in simulation: {}\nkept: the weights after {kept} batches\n",
        told.join(", ")
    )
}

/// Where the tasks of a part are in tables.
fn places(tables: &[Table], part: Split) -> Result<Vec<Place>> {
    let of = |(table, t): (usize, &Table)| {
        let mine = t.tasks().iter().enumerate().filter(|(_, task)| task.split == part);
        mine.map(|(task, _)| Place { table, task }).collect::<Vec<_>>()
    };
    let found: Vec<Place> = tables.iter().enumerate().flat_map(of).collect();
    if found.is_empty() {
        let allowed = format!("tables with {} tasks", part.name());
        return Err(Error::input("--outcomes", format!("no {} task", part.name()), allowed));
    }
    Ok(found)
}

pub fn evaluate_policy(args: &EvaluateArgs) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.task)?;
    iplw::error::within("--candidates", args.candidates as f64, 1.0, 1e6)?;
    let part = parse::part(&args.split)?;
    let bytes = std::fs::read(&args.policy).map_err(|e| Error::io(&args.policy, e))?;
    let policy = Dqn::from_safetensors(&bytes).map_err(|e| e.at(args.policy.display()))?;
    if !args.outcomes.is_empty() {
        return evaluate_in_tables(args, &policy, part);
    }
    let tasks = parse::fold(tasks, family, args.fold)?;
    let chosen = if tasks.len() > 1 { split(&tasks, part) } else { tasks };
    policy.fits(&chosen[0]).map_err(|e| e.at(args.policy.display()))?;
    let hidden = parse::real(&args.real, standard(family))?;
    let config = EvaluateConfig { candidates: args.candidates, ..EvaluateConfig::phyre(args.seed) };
    let bar = output::Bar::new();
    let found = try_out(&policy, &chosen, &hidden, &config, &bar)?;
    bar.clear();
    tell(args, &chosen, &found)
}

/// The same where tables say what an action does.
fn evaluate_in_tables(args: &EvaluateArgs, policy: &Dqn, part: Split) -> Result<()> {
    let tables: Vec<Table> = read_all("--outcomes", &args.outcomes)?.into_iter().map(|r| r.table).collect();
    let bar = output::Bar::new();
    let (places, mut tasks, mut solved_at) = (places(&tables, part)?, Vec::new(), Vec::new());
    for (i, place) in places.iter().enumerate() {
        bar.report("evaluate", i as u64, places.len() as u64)?;
        let (table, task) = (&tables[place.table], &tables[place.table].tasks()[place.task]);
        policy.fits(task).map_err(|e| e.at(args.policy.display()))?;
        solved_at.push(table.solved_at(place.task, &rank(policy, task, table.actions(), CHUNK)?));
        tasks.push(task.clone());
    }
    bar.clear();
    tell(args, &tasks, &Evaluation::of(solved_at))
}

fn tell(args: &EvaluateArgs, chosen: &[Task], found: &Evaluation) -> Result<()> {
    if args.json {
        let rows: Vec<_> =
            chosen.iter().zip(&found.solved_at).map(|(t, k)| json!({"task": t.id, "solved_at": k})).collect();
        let document =
            json!({"auccess": found.auccess, "solved_within": found.curve.to_vec(), "tasks": rows});
        return output::print(&format!("{document:#}\n"));
    }
    let mut text = format!("AUCCESS {:.3} on {} tasks\n", found.auccess, chosen.len());
    for (task, k) in chosen.iter().zip(&found.solved_at) {
        let at = k.map_or("not within 100".to_string(), |k| format!("at attempt {k}"));
        text += &format!("  {:<16} {at}\n", task.id);
    }
    output::print(&text)
}
