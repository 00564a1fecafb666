//! `iplw plan`: a task's actions ranked by rollouts under what is believed, and what that is worth in a hidden world.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iplw::budget::{Budget, Endless};
use iplw::error::{Error, Result, within};
use iplw::estimate::Belief;
use iplw::estimate::belief::PRIOR_DRAWS;
use iplw::experiment::planning::{PlannedTask, PlanningConfig, PlanningScore, plan_and_try, score};
use iplw::picture::plan_svgs;
use iplw::plan::{PlanConfig, PlanDocument, document, plan};
use iplw::reality::{HiddenWorld, standard};
use iplw::task::{DEFAULT_FAMILY, Family, Split, Task, split};
use iplw::world::Engine;
use serde::Serialize;
use serde_json::{Value, json};

use super::cells::Cells;
use super::{output, parse, planned};

/// Tries every action of a task in worlds drawn from what is believed, moved a little each time, and ranks them by how often they
/// solve it. The best are exactly those of trying everything; their probabilities come from fresh draws.
///
/// Of a whole family every test task is planned and the order tried in a hidden world: AUCCESS under the belief, the prior and
/// the truth, and whether predicted probabilities are true. Stopped, it goes on where it was when it is begun again.
#[derive(clap::Args)]
pub struct Args {
    /// One task such as bowling:017, or a family.
    #[arg(long, default_value = DEFAULT_FAMILY)]
    task: String,
    /// What is believed: draws of a posterior (`iplw.posterior/1`).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["prior", "latents", "effects"])]
    belief: Option<PathBuf>,
    /// What is believed: the family's prior. The default.
    #[arg(long, conflicts_with = "latents")]
    prior: bool,
    /// What is believed: one world, `density=..,friction=..,restitution=..`; the scene's own where not given.
    #[arg(long)]
    latents: Option<String>,
    /// Effect of the believed world, `name:parameter=value,...`; may be repeated.
    #[arg(long = "effect", value_name = "EFFECT")]
    effects: Vec<String>,
    /// Actions looked at.
    #[arg(long, default_value_t = 10_000)]
    actions: usize,
    /// Worlds in which an action is tried, at most; and as many fresh ones for the best.
    #[arg(long, default_value_t = 64)]
    draws: usize,
    /// Most that a component of an action, in [0, 1], is moved in a copy; 0 tries actions as they are.
    #[arg(long, default_value_t = iplw::reality::certify::PERTURBATION)]
    perturb: f64,
    /// So many of the best are exact, and tried again under fresh draws.
    #[arg(long, default_value_t = 10)]
    exact: usize,
    /// Most seconds of the race; what is known by then is the answer.
    #[arg(long)]
    seconds: Option<f64>,
    /// Most rollouts of the race; likewise.
    #[arg(long)]
    rollouts: Option<usize>,
    /// Engine that simulates: auto, rapier or lanes.
    #[arg(long, default_value = "auto")]
    engine: String,
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Of a family: the hidden world, over the family's own: `damping=0.8,density=..,friction=..,restitution=..,engine=..`.
    #[arg(long)]
    real: Option<String>,
    /// Of a family: prior, belief (what --belief or --latents says) and truth; all that there are if not given.
    #[arg(long, value_delimiter = ',')]
    rows: Vec<String>,
    /// Of a family: actions of each tenth of a plan's shares whose predicted success is held against the hidden world's.
    #[arg(long, default_value_t = 20)]
    predictions: usize,
    /// Directory for plan.json and the maps; of a family `plans` if not given.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// Actions in the table.
const SHOWN: usize = 10;

pub fn run(args: &Args) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.task)?;
    let config = config(args)?;
    match tasks.as_slice() {
        [task] if args.task != family.name => one(args, task, family, &config),
        _ => whole(args, &tasks, family, config),
    }
}

fn config(args: &Args) -> Result<PlanConfig> {
    let config = PlanConfig {
        actions: args.actions,
        draws: args.draws,
        perturb: args.perturb,
        exact: args.exact,
        rollouts: args.rollouts,
        engine: Engine::from_name(&args.engine)?,
        ..PlanConfig::standard(args.seed)
    };
    config.validate()?;
    within("--predictions", args.predictions as f64, 0.0, 10_000.0)?;
    args.seconds.map_or(Ok(0.0), |s| within("--seconds", s, 0.0, 1e6))?;
    Ok(config)
}

/// Plans one task.
fn one(args: &Args, task: &Task, family: &Family, config: &PlanConfig) -> Result<()> {
    let given = [("--real", args.real.is_some()), ("--rows", !args.rows.is_empty())];
    if let Some((option, _)) = given.iter().find(|(_, given)| *given) {
        return Err(Error::input(
            *option,
            "given for one task",
            "a whole family as --task, whose orders are tried",
        ));
    }
    let belief = match given_belief(args)? {
        Some(belief) => belief,
        None => prior(args, family)?,
    };
    args.out.as_deref().map_or(Ok(()), |out| output::directory("--out", out))?;
    let (bar, started) = (output::Bar::new(), Instant::now());
    let found = plan(task, &belief, config, until(args.seconds).as_ref(), &bar)?;
    bar.clear();
    let seconds = started.elapsed().as_secs_f64();
    let document = document(&found, config, &belief);
    let text = pretty(&document)?;
    if let Some(out) = &args.out {
        output::write_whole(&out.join("plan.json"), text.as_bytes())?;
        for (i, svg) in plan_svgs(task, &found).iter().enumerate() {
            let name = if i == 0 { "map.svg".to_string() } else { format!("map_{}.svg", i + 1) };
            output::write_whole(&out.join(name), svg.as_bytes())?;
        }
    }
    output::print(&if args.json { text } else { told(task, &document, seconds, args.out.as_deref()) })
}

/// What --belief or --latents says, if either is given.
fn given_belief(args: &Args) -> Result<Option<Belief>> {
    if let Some(path) = &args.belief {
        return parse::belief(path).map(Some);
    }
    let Some(latents) = &args.latents else { return Ok(None) };
    Belief::point(parse::latents(latents)?, parse::effects(&args.effects)?).map(Some)
}

fn prior(args: &Args, family: &Family) -> Result<Belief> {
    Belief::prior(family.prior, parse::effects(&args.effects)?, PRIOR_DRAWS.max(2 * args.draws), args.seed)
}

/// Plans every test task and tries the orders in the hidden world.
fn whole(args: &Args, tasks: &[Task], family: &Family, config: PlanConfig) -> Result<()> {
    let hidden = parse::real(args.real.as_deref().unwrap_or(""), standard(family))?;
    let truth = HiddenWorld::new(hidden.clone())?.reveal();
    let mut beliefs = vec![("prior", prior(args, family)?)];
    beliefs.extend(given_belief(args)?.map(|belief| ("belief", belief)));
    beliefs.push(("truth", Belief::point(truth.latents, truth.effects)?));
    if !args.rows.is_empty() {
        let known: Vec<&str> = beliefs.iter().map(|(name, _)| *name).collect();
        if let Some(odd) = args.rows.iter().find(|r| !known.contains(&r.as_str())) {
            let allowed =
                format!("some of {} (belief, where --belief or --latents is given)", known.join(", "));
            return Err(Error::input("--rows", format!("{odd:?}"), allowed));
        }
        beliefs.retain(|(name, _)| args.rows.iter().any(|r| r == name));
    }
    let test = split(tasks, Split::Test);
    let tasks = if test.is_empty() { tasks.to_vec() } else { test };
    if tasks.is_empty() {
        return Err(Error::input("--task", format!("{:?}", family.name), "a family with certified tasks"));
    }
    let out = args.out.clone().unwrap_or_else(|| "plans".into());
    let setup = PlanningConfig { plan: config, hidden, predictions: args.predictions };
    let cells = Cells::new(&out, beliefs.len() * tasks.len())?;
    let mut rows = Vec::new();
    for (name, belief) in &beliefs {
        let mut found = Vec::new();
        for task in &tasks {
            let of =
                json!({"setup": setup, "belief": belief.draws(), "seconds": args.seconds, "task": task.id});
            let make = |progress: &dyn iplw::progress::Progress| {
                plan_and_try(task, belief, &setup, until(args.seconds).as_ref(), progress)
            };
            let (planned, seconds) = cells.get(&format!("{name}-{}", task.id), &of, make)?;
            found.push((planned, seconds));
        }
        rows.push(Row::of(name, &tasks, found));
    }
    cells.finish();
    let about = json!({"format": "iplw.planning/1", "version": env!("CARGO_PKG_VERSION"), "family": family.name,
        "config": setup, "rows": rows});
    let text = pretty(&about)?;
    output::write_whole(&out.join("planning.json"), text.as_bytes())?;
    let scores: Vec<_> = rows.iter().map(|row| (row.name.as_str(), &row.score)).collect();
    let page = planned::page(family.name, tasks.len(), &scores);
    output::write_whole(&out.join("report.html"), page.as_bytes())?;
    output::print(&if args.json { text } else { table(&rows, tasks.len(), &out) })
}

/// A belief's plans.
#[derive(Serialize)]
struct Row {
    name: String,
    score: PlanningScore,
    /// Mean copies of a plan.
    rollouts: f64,
    /// Median of what a task took, with its tries and predictions, s.
    seconds: f64,
    tasks: Vec<Value>,
}

impl Row {
    fn of(name: &str, tasks: &[Task], found: Vec<(PlannedTask, f64)>) -> Row {
        let (planned, mut seconds): (Vec<PlannedTask>, Vec<f64>) = found.into_iter().unzip();
        seconds.sort_by(f64::total_cmp);
        let one = |(task, p): (&Task, &PlannedTask)| json!({"task": task.id, "solved_at": p.solved_at, "rollouts": p.rollouts, "complete": p.complete});
        Row {
            name: name.into(),
            score: score(&planned),
            rollouts: planned.iter().map(|p| p.rollouts as f64).sum::<f64>() / planned.len() as f64,
            seconds: seconds[seconds.len() / 2],
            tasks: tasks.iter().zip(&planned).map(one).collect(),
        }
    }
}

/// Looks at a clock; without one, endless.
fn until(seconds: Option<f64>) -> Box<dyn Budget> {
    struct Until(Instant, f64);
    impl Budget for Until {
        fn look(&self) -> Result<()> {
            let over = Instant::now() >= self.0;
            if over { Err(Error::Deadline { seconds: self.1 }) } else { Ok(()) }
        }
    }
    match seconds {
        Some(s) => Box::new(Until(Instant::now() + Duration::from_secs_f64(s), s)),
        None => Box::new(Endless),
    }
}

fn pretty(value: &impl Serialize) -> Result<String> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Error::Failed(e.to_string()))?;
    Ok(text + "\n")
}

/// A plan for people.
fn told(task: &Task, plan: &PlanDocument, seconds: f64, out: Option<&Path>) -> String {
    let names: Vec<String> = task
        .actions()
        .components
        .iter()
        .map(|c| format!("{}.{}", c.target, format!("{:?}", c.set).to_lowercase()))
        .collect();
    let mut text = format!(
        "{}: {} actions, {} cannot be placed; {} rollouts under {} draws, {seconds:.1} s\n",
        plan.task, plan.candidates, plan.invalid, plan.rollouts, plan.config.draws
    );
    text += &format!("probability     solved of raced   {}\n", names.join(", "));
    for row in plan.actions.iter().take(SHOWN) {
        let probability = match (row.probability, row.standard_error) {
            (Some(p), Some(e)) => format!("{p:.3} +- {e:.3}"),
            _ => "-".into(),
        };
        let values: Vec<String> = row.action.iter().map(|v| format!("{v:.4}")).collect();
        let raced = format!("{} of {}", row.successes, row.draws);
        text += &format!("{probability:<15} {raced:>15}   {}\n", values.join(", "));
    }
    if !plan.complete {
        text += "not complete: there may be better ones among those that were not tried to the end\n";
    }
    out.map_or(text.clone(), |out| format!("{text}plan and maps: {}\n", out.display()))
}

/// Rows for people.
fn table(rows: &[Row], tasks: usize, out: &Path) -> String {
    let mut text = format!("{tasks} test tasks of the hidden world\n");
    text += "belief    AUCCESS   first attempt   complete   calibration error   rollouts a plan\n";
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
