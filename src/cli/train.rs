//! `iplw train` and `iplw evaluate`: training of a policy, and its evaluation in a hidden world.

use std::path::PathBuf;
use std::time::Instant;

use iplw::commands::{TrainingPreset, TrainingRequest};
use iplw::error::{Error, Result};
use iplw::experiment::evaluate_in_hidden_world;
use iplw::policy::{
    CHUNK, Dqn, EarlyStopping, EvaluateConfig, Evaluation, LabelConfig, LabelledData, OutcomeDataset,
    OutcomeTable, SimulatedValidator, TaskIndex, TrainConfig, TrainLog, TrainingPhysics, label, rank, train,
    train_with_early_stopping,
};
use iplw::progress::Progress;
use iplw::task::{DEFAULT_FAMILY, LabelCounts, Learning, Split, Task, split};
use iplw::world::Latents;
use serde_json::json;

use super::outcomes::read_all;
use super::{output, parse};

/// Train a policy in simulation; writes its weights.
///
/// Labels random actions of the training tasks by simulation and trains a policy on them.
#[derive(clap::Args)]
pub struct TrainArgs {
    #[command(flatten)]
    request: TrainingRequest,
    /// Posterior samples (iplw.posterior/2): every action is labelled in a sampled world.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["latents", "training", "effects"])]
    posterior: Option<PathBuf>,
    /// Learn from tables of `iplw outcomes`, one per family, without simulation.
    ///
    /// With several families, the policy applies to all families with the same kind of actions.
    #[arg(long, num_args = 1.., value_name = "DIR", conflicts_with_all = ["task", "latents", "training", "posterior", "effects", "preset", "fold"])]
    outcomes: Vec<PathBuf>,
    /// Labelled actions per training task, at least [default: the family's]
    #[arg(long)]
    per_task: Option<usize>,
    /// Fold: another random split of the family's tasks into train, validation and test [default: 0]
    #[arg(long)]
    fold: Option<u64>,
    /// Output file of the weights (safetensors).
    #[arg(long, default_value = "policy.safetensors")]
    out: PathBuf,
}

/// Evaluate a policy in a hidden world.
///
/// Ranks the actions of each task by a policy and executes them in the hidden world, best first, up to 100 attempts.
#[derive(clap::Args)]
pub struct EvaluateArgs {
    /// Family, or a task such as bowling:017.
    #[arg(long, default_value = DEFAULT_FAMILY)]
    task: String,
    /// Evaluate on tables of `iplw outcomes` instead, without simulation.
    #[arg(long, num_args = 1.., value_name = "DIR", conflicts_with_all = ["task", "real", "candidates"])]
    outcomes: Vec<PathBuf>,
    /// Weights of `iplw train`.
    #[arg(long)]
    policy: PathBuf,
    /// Split: train, validation or test.
    #[arg(long, default_value = "test")]
    split: String,
    /// Fold of `iplw train --fold` [default: 0]
    #[arg(long, conflicts_with = "outcomes")]
    fold: Option<u64>,
    /// Hidden world: damping=0.8,density=..,friction=..,restitution=.. [default: the family's]
    #[arg(long, default_value = "")]
    real: String,
    /// Number of actions ranked per task.
    #[arg(long, default_value_t = 10_000)]
    candidates: usize,
    /// Random seed.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

pub fn train_policy(args: &TrainArgs) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.request.task)?;
    let tasks = parse::fold(tasks, family, args.fold)?;
    let saturating = saturating(args, &tasks)?;
    let usual = match args.outcomes.as_slice() {
        [] if saturating => family.learning.saturating(),
        [] => family.learning,
        _ => Learning::STANDARD,
    };
    let per_task = args.per_task.unwrap_or(usual.labels.per_task);
    iplw::error::check_range("--per-task", per_task as f64, 1.0, 50_000.0)?;
    let labels = LabelCounts { per_task, ..usual.labels };
    let config = args.request.config(&usual)?;
    let seed = config.seed;
    output::prepare_file("--out", &args.out)?;
    if !args.outcomes.is_empty() {
        let tables: Vec<OutcomeTable> =
            read_all("--outcomes", &args.outcomes)?.into_iter().map(|r| r.table).collect();
        let lesson = OutcomeDataset::new(&tables, &task_indices(&tables, Split::Train)?, &labels, seed);
        let [solving, failing] = lesson.counts();
        return train_and_save(args, &lesson, [solving + failing, solving], &config, None);
    }
    let training = match &args.posterior {
        Some(path) => TrainingPhysics::from_posterior(&parse::parameter_samples(path)?),
        None => args.request.clone().physics(Latents::default())?,
    };
    let bar = output::TerminalProgress::new();
    let own = if tasks.len() > 1 { split(&tasks, Split::Train) } else { tasks.clone() };
    let data = label(&own, &training, &LabelConfig::preset(&labels, seed), &bar)?;
    bar.clear();
    let counts = [data.rows.len(), data.solving()];
    if !saturating {
        return train_and_save(args, &data, counts, &config, None);
    }
    let until = EarlyStopping::standard(&config);
    let validation = split(&tasks, Split::Validation);
    let judge = SimulatedValidator::of_training(&training, &validation, until.worlds, seed)?;
    train_and_save(args, &data, counts, &config, Some((&judge, &until)))
}

/// Whether to train until validation performance saturates.
fn saturating(args: &TrainArgs, tasks: &[Task]) -> Result<bool> {
    let TrainingRequest { task, preset, batches, .. } = &args.request;
    let can = tasks.len() > 1 && tasks.iter().any(|t| t.split == Split::Validation);
    match preset {
        Some(TrainingPreset::Paper) => Ok(false),
        None => Ok(can && batches.is_none() && args.outcomes.is_empty()),
        Some(TrainingPreset::Saturating) if batches.is_some() => {
            Err(Error::input("--batches", "given beside --preset saturating", "one or the other"))
        }
        Some(TrainingPreset::Saturating) if !can => {
            let allowed = "a family with validation tasks, which determine when to stop";
            Err(Error::input("--task", format!("{task:?} with --preset saturating"), allowed))
        }
        Some(TrainingPreset::Saturating) => Ok(true),
    }
}

/// Trains on labelled actions ([all, successful] of them) and writes the weights; with a validator, until saturation.
fn train_and_save(
    args: &TrainArgs,
    data: &dyn LabelledData,
    [all, solving]: [usize; 2],
    config: &TrainConfig,
    validator: Option<(&SimulatedValidator, &EarlyStopping)>,
) -> Result<()> {
    let (bar, started) = (output::TerminalProgress::new(), Instant::now());
    let (policy, log) = match validator {
        None => train(data, config, &bar)?,
        Some((judge, until)) => train_with_early_stopping(data, judge, config, until, &bar)?,
    };
    bar.clear();
    output::write_whole(&args.out, &policy.weights())?;
    let tail = &log.loss[log.loss.len().saturating_sub(100)..];
    output::print(&format!(
        "{all} actions labelled ({solving} solve), {} batches in {:.1} s\nmean loss of the last {} batches: {:.3} nats\n{}weights: {}\n",
        log.loss.len(),
        started.elapsed().as_secs_f64(),
        tail.len(),
        tail.iter().sum::<f32>() / tail.len().max(1) as f32,
        validation_summary(&policy, &log),
        args.out.display()
    ))
}

/// Validation results, and the number of updates of the selected weights.
fn validation_summary(policy: &Dqn, log: &TrainLog) -> String {
    if log.validation.is_empty() {
        return String::new();
    }
    let selected = policy.card().batches();
    let checks: Vec<String> =
        log.validation.iter().map(|c| format!("{:.3} after {}", c.auccess, c.batches)).collect();
    format!(
        "AUCCESS on the validation tasks in simulation: {}\nkept: the weights after {selected} batches\n",
        checks.join(", ")
    )
}

/// Indices of a split's tasks in tables.
fn task_indices(tables: &[OutcomeTable], part: Split) -> Result<Vec<TaskIndex>> {
    let of = |(table, t): (usize, &OutcomeTable)| {
        let indices = t.tasks().iter().enumerate().filter(|(_, task)| task.split == part);
        indices.map(|(task, _)| TaskIndex { table, task }).collect::<Vec<_>>()
    };
    let found: Vec<TaskIndex> = tables.iter().enumerate().flat_map(of).collect();
    if found.is_empty() {
        let allowed = format!("tables with {} tasks", part.name());
        return Err(Error::input("--outcomes", format!("no {} task", part.name()), allowed));
    }
    Ok(found)
}

pub fn evaluate_policy(args: &EvaluateArgs) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.task)?;
    iplw::error::check_range("--candidates", args.candidates as f64, 1.0, 1e6)?;
    let part = parse::part(&args.split)?;
    let bytes = std::fs::read(&args.policy).map_err(|e| Error::io(&args.policy, e))?;
    let policy = Dqn::from_safetensors(&bytes).map_err(|e| e.in_file(args.policy.display()))?;
    if !args.outcomes.is_empty() {
        return evaluate_in_tables(args, &policy, part);
    }
    let tasks = parse::fold(tasks, family, args.fold)?;
    let chosen = if tasks.len() > 1 { split(&tasks, part) } else { tasks };
    policy.check_compatible(&chosen[0]).map_err(|e| e.in_file(args.policy.display()))?;
    let hidden = parse::real(&args.real, family)?;
    let config = EvaluateConfig { candidates: args.candidates, ..EvaluateConfig::phyre(args.seed) };
    let bar = output::TerminalProgress::new();
    let found = evaluate_in_hidden_world(&policy, &chosen, &hidden, &config, &bar)?;
    bar.clear();
    print_evaluation(args, &chosen, &found)
}

/// Evaluation on tables of outcomes.
fn evaluate_in_tables(args: &EvaluateArgs, policy: &Dqn, part: Split) -> Result<()> {
    let tables: Vec<OutcomeTable> =
        read_all("--outcomes", &args.outcomes)?.into_iter().map(|r| r.table).collect();
    let bar = output::TerminalProgress::new();
    let (places, mut tasks, mut solved_at) = (task_indices(&tables, part)?, Vec::new(), Vec::new());
    for (i, place) in places.iter().enumerate() {
        bar.report("evaluate", i as u64, places.len() as u64)?;
        let (table, task) = (&tables[place.table], &tables[place.table].tasks()[place.task]);
        policy.check_compatible(task).map_err(|e| e.in_file(args.policy.display()))?;
        solved_at.push(table.solved_at(place.task, &rank(policy, task, table.actions(), CHUNK)?));
        tasks.push(task.clone());
    }
    bar.clear();
    print_evaluation(args, &tasks, &Evaluation::of(solved_at))
}

fn print_evaluation(args: &EvaluateArgs, chosen: &[Task], found: &Evaluation) -> Result<()> {
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
