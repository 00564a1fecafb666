//! `iplw plan`: ranks actions by simulated success over parameter samples, and evaluates plans in a hidden world.

use std::path::{Path, PathBuf};
use std::time::Instant;

use iplw::budget::Unlimited;
use iplw::commands::{PlanRequest, TimeLimit};
use iplw::error::{Error, Result, check_range};
use iplw::estimate::ParameterSamples;
use iplw::experiment::planning::{
    PlanEvaluation, PlanningConfig, PlanningScore, evaluate_plan, evaluate_random, score,
};
use iplw::picture::plan_svgs;
use iplw::plan::{PlanConfig, PlanDocument, document, plan};
use iplw::reality::HiddenWorld;
use iplw::report;
use iplw::task::{Family, Split, Task, split};
use iplw::world::Latents;
use serde::Serialize;
use serde_json::{Value, json};

use super::cell_store::CellStore;
use super::{output, parse, plan_report};

/// Rank a task's actions by probability of success; for a family, evaluate the plans in a hidden world.
///
/// Simulates the actions of a task in worlds sampled from the prior or posterior, slightly perturbed, and ranks them by success rate. The
/// best actions are exactly those of an exhaustive evaluation; their probabilities come from fresh samples.
///
/// For a whole family, every test task is planned and the plans are evaluated in a hidden world: AUCCESS for posterior, prior and truth, and
/// the calibration of predicted probabilities. An interrupted run resumes.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    request: PlanRequest,
    /// Posterior samples (iplw.posterior/2) [default: the family's prior]
    #[arg(long, value_name = "FILE", conflicts_with_all = ["prior", "latents", "effects"])]
    posterior: Option<PathBuf>,
    /// Use the family's prior (the default).
    #[arg(long, conflicts_with = "latents")]
    prior: bool,
    /// Hidden world, for a family: damping=0.8,density=..,friction=..,.. [default: the family's]
    #[arg(long)]
    real: Option<String>,
    /// Rows, for a family: random, uncalibrated, prior, posterior (of --posterior or --latents), truth [default: all available]
    #[arg(long, value_delimiter = ',')]
    rows: Vec<String>,
    /// Actions per bin of predicted success for the calibration, for a family.
    #[arg(long, default_value_t = 20)]
    predictions: usize,
    /// Output directory [default: none for a task, plans for a family]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// Number of actions in the table.
const MAX_LISTED_ACTIONS: usize = 10;

pub fn run(args: &Args) -> Result<()> {
    let request = &args.request;
    let (tasks, family) = parse::tasks(&request.task)?;
    let config = request.config()?;
    check_range("--predictions", args.predictions as f64, 0.0, 10_000.0)?;
    request.seconds.map_or(Ok(0.0), |s| check_range("--seconds", s, 0.0, 1e6))?;
    match tasks.as_slice() {
        [task] if request.task != family.name => plan_task(args, task, &config),
        _ => plan_family(args, &tasks, family, config),
    }
}

/// Plans one task.
fn plan_task(args: &Args, task: &Task, config: &PlanConfig) -> Result<()> {
    let given = [("--real", args.real.is_some()), ("--rows", !args.rows.is_empty())];
    if let Some((option, _)) = given.iter().find(|(_, given)| *given) {
        return Err(Error::input(*option, "given for a single task", "a family as --task"));
    }
    let samples = samples(args, &args.request, config)?;
    args.out.as_deref().map_or(Ok(()), |out| output::prepare_directory("--out", out))?;
    let (bar, started) = (output::TerminalProgress::new(), Instant::now());
    let found = plan(task, &samples, config, &TimeLimit::new(args.request.seconds, &Unlimited), &bar)?;
    bar.clear();
    let seconds = started.elapsed().as_secs_f64();
    let document = document(task, &found, config, &samples);
    let text = output::pretty_json(&document)?;
    if let Some(out) = &args.out {
        output::write_whole(&out.join("plan.json"), text.as_bytes())?;
        let page = report::plan::report(&document, Some(task)).to_html();
        output::write_whole(&out.join("report.html"), page.as_bytes())?;
        for (i, svg) in plan_svgs(task, &document).iter().enumerate() {
            let name = if i == 0 { "map.svg".to_string() } else { format!("map_{}.svg", i + 1) };
            output::write_whole(&out.join(name), svg.as_bytes())?;
        }
    }
    output::print(&if args.json { text } else { summary(task, &document, seconds, args.out.as_deref()) })
}

/// Parameter samples of --posterior, or of the request.
fn samples(args: &Args, request: &PlanRequest, config: &PlanConfig) -> Result<ParameterSamples> {
    match &args.posterior {
        Some(path) => parse::parameter_samples(path),
        None => request.clone().parameter_source()?.samples(&request.task, config),
    }
}

/// Plans every test task and evaluates the plans in the hidden world.
fn plan_family(args: &Args, tasks: &[Task], family: &Family, config: PlanConfig) -> Result<()> {
    let hidden = parse::real(args.real.as_deref().unwrap_or(""), family)?;
    let truth = HiddenWorld::new(hidden.clone())?.reveal();
    let prior = PlanRequest { latents: None, ..args.request.clone() };
    // Actions in random order need no samples.
    let mut samples_by_row = vec![
        ("random", None),
        ("uncalibrated", Some(ParameterSamples::point(Latents::of(family.prior_means()), Vec::new())?)),
        ("prior", Some(prior.clone().parameter_source()?.samples(&prior.task, &config)?)),
    ];
    if args.posterior.is_some() || args.request.latents.is_some() {
        samples_by_row.push(("posterior", Some(samples(args, &args.request, &config)?)));
    }
    samples_by_row.push(("truth", Some(ParameterSamples::point(truth.latents, truth.effects)?)));
    if !args.rows.is_empty() {
        let known: Vec<&str> = samples_by_row.iter().map(|(name, _)| *name).collect();
        if let Some(unknown) = args.rows.iter().find(|r| !known.contains(&r.as_str())) {
            let allowed =
                format!("some of {} (posterior, where --posterior or --latents is given)", known.join(", "));
            return Err(Error::input("--rows", format!("{unknown:?}"), allowed));
        }
        samples_by_row.retain(|(name, _)| args.rows.iter().any(|r| r == name));
    }
    let test = split(tasks, Split::Test);
    let tasks = if test.is_empty() { tasks.to_vec() } else { test };
    if tasks.is_empty() {
        return Err(Error::input("--task", format!("{:?}", family.name), "a family with certified tasks"));
    }
    let out = args.out.clone().unwrap_or_else(|| "plans".into());
    let seconds = args.request.seconds;
    let setup = PlanningConfig { plan: config, hidden, predictions: args.predictions };
    let cells = CellStore::new(&out, samples_by_row.len() * tasks.len())?;
    let mut rows = Vec::new();
    for (name, samples) in &samples_by_row {
        let mut found = Vec::new();
        for task in &tasks {
            let draws = samples.as_ref().map(ParameterSamples::draws);
            let of = json!({"setup": setup, "belief": draws, "seconds": seconds, "task": task.id});
            let make = |progress: &dyn iplw::progress::Progress| match samples {
                None => evaluate_random(task, &setup, progress),
                Some(samples) => {
                    evaluate_plan(task, samples, &setup, &TimeLimit::new(seconds, &Unlimited), progress)
                }
            };
            let planned = cells.get_or_compute(&format!("{name}-{}", task.id), &of, make)?;
            found.push(planned);
        }
        rows.push(PlanningRow::of(name, &tasks, found));
    }
    cells.finish();
    let about = json!({"format": "iplw.planning/1", "version": env!("CARGO_PKG_VERSION"), "family": family.name,
        "config": setup, "rows": rows});
    let text = output::pretty_json(&about)?;
    output::write_whole(&out.join("planning.json"), text.as_bytes())?;
    let scores: Vec<_> = rows.iter().map(|row| (row.name.as_str(), &row.score)).collect();
    let page = plan_report::page(family.name, tasks.len(), &scores);
    output::write_whole(&out.join("report.html"), page.as_bytes())?;
    output::print(&if args.json { text } else { table(&rows, tasks.len(), &out) })
}

/// Results for one source of parameter samples.
#[derive(Serialize)]
struct PlanningRow {
    name: String,
    score: PlanningScore,
    /// Mean rollouts per plan.
    rollouts: f64,
    /// Median time per task, evaluation included, s.
    seconds: f64,
    tasks: Vec<Value>,
}

impl PlanningRow {
    fn of(name: &str, tasks: &[Task], found: Vec<(PlanEvaluation, f64)>) -> PlanningRow {
        let (planned, mut seconds): (Vec<PlanEvaluation>, Vec<f64>) = found.into_iter().unzip();
        seconds.sort_by(f64::total_cmp);
        let one = |(task, p): (&Task, &PlanEvaluation)| json!({"task": task.id, "solved_at": p.solved_at, "rollouts": p.rollouts, "complete": p.complete});
        PlanningRow {
            name: name.into(),
            score: score(&planned),
            rollouts: planned.iter().map(|p| p.rollouts as f64).sum::<f64>() / planned.len() as f64,
            seconds: seconds[seconds.len() / 2],
            tasks: tasks.iter().zip(&planned).map(one).collect(),
        }
    }
}

/// A plan as text.
fn summary(task: &Task, plan: &PlanDocument, seconds: f64, out: Option<&Path>) -> String {
    let names: Vec<String> = task
        .actions()
        .components
        .iter()
        .map(|c| format!("{}.{}", c.target, format!("{:?}", c.set).to_lowercase()))
        .collect();
    let mut text = format!(
        "{}: {} actions, {} invalid; {} rollouts, up to {} per action, {seconds:.1} s\n",
        plan.task, plan.candidates, plan.invalid, plan.rollouts, plan.config.draws
    );
    text += &format!("probability            ranking   {}\n", names.join(", "));
    for row in plan.actions.iter().take(MAX_LISTED_ACTIONS) {
        let probability = match (row.probability, row.standard_error) {
            (Some(p), Some(e)) => format!("{p:.3} +- {e:.3}"),
            _ => "-".into(),
        };
        let values: Vec<String> = row.action.iter().map(|v| format!("{v:.4}")).collect();
        let raced = format!("{} of {}", row.successes, row.draws);
        text += &format!("{probability:<15} {raced:>15}   {}\n", values.join(", "));
    }
    if !plan.complete {
        text += "not complete: actions that were not fully evaluated may be better\n";
    }
    out.map_or(text.clone(), |out| format!("{text}plan and maps: {}\n", out.display()))
}

/// Rows as a text table.
fn table(rows: &[PlanningRow], tasks: usize, out: &Path) -> String {
    let mut text = format!("{tasks} test tasks of the hidden world\n");
    text += "samples   AUCCESS   first attempt   complete   calibration error   rollouts per plan\n";
    for row in rows {
        let (s, n) = (&row.score, row.score.calibration.bins.iter().map(|b| b.count).sum::<usize>());
        text += &format!(
            "{:<9} {:>7.3} {:>13.0} % {:>8.0} % {:>11.3} of {n:<6} {:>14.0}\n",
            row.name,
            s.auccess,
            100.0 * s.first,
            100.0 * s.complete,
            s.calibration.error,
            row.rollouts
        );
    }
    text + &format!("report: {}\n", out.join("report.html").display())
}
