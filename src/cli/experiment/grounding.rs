//! `iplw experiment grounding`: what a few real interactions, spent one way or another, are worth to plans.

use iplw::budget::Endless;
use iplw::error::{Error, Result};
use iplw::estimate::Belief;
use iplw::estimate::belief::PRIOR_DRAWS;
use iplw::experiment::estimators::Estimator;
use iplw::experiment::grounding::{GroundingConfig, Known, ground};
use iplw::experiment::planning::{PlannedTask, PlanningConfig, plan_and_try};
use iplw::experiment::statistics::Summary;
use iplw::plan::PlanConfig;
use iplw::policy::Evaluation;
use iplw::reality::{HiddenConfig, HiddenWorld, standard};
use iplw::task::{Family, Split, Task, family, split};
use iplw::world::{DRAG, EffectParameter};
use serde::Serialize;
use serde_json::json;

use super::args::ExperimentArgs;
use crate::cli::cells::Cells;
use crate::cli::{output, parse};

/// Ways that are compared, if none are named.
const WAYS: [&str; 5] = ["random", "informative", "probing", "success", "acting"];
/// Rollouts of a plan.
const ROLLOUTS: usize = 40_000;

/// What a belief's plans come to in a hidden world.
#[derive(Serialize)]
struct Row {
    way: String,
    /// Nobody's where nothing was measured.
    estimator: Option<Estimator>,
    seed: u64,
    interactions: usize,
    /// Interactions that solved the task that they were made in.
    solved: usize,
    /// Name, mean, and standard deviation where the estimator has one.
    numbers: Vec<(String, f64, Option<f64>)>,
    /// By number: how far the mean is from the truth.
    off: Vec<(String, f64)>,
    converged: bool,
    auccess: f64,
    first: f64,
    seconds: f64,
}

impl Row {
    /// For people.
    fn arm(&self) -> String {
        arm(&self.way, self.estimator)
    }
}

pub fn run(args: &ExperimentArgs) -> Result<()> {
    let family = family(&args.task)?;
    let hidden = parse::real(args.real.as_deref().unwrap_or(""), standard(family))?;
    let set = parse::set(args.set.as_deref().unwrap_or(DRAG.effect.name));
    let named: Vec<&str> = args.ways.iter().flatten().map(String::as_str).collect();
    let ways = if named.is_empty() { WAYS.to_vec() } else { named };
    let estimators = match &args.estimators {
        Some(names) => names.iter().map(|n| Estimator::from_name(n)).collect::<Result<Vec<_>>>()?,
        None => vec![Estimator::default()],
    };
    let mut arms: Vec<(&str, Estimator)> = Vec::new();
    for arm in estimators.iter().flat_map(|e| ways.iter().map(|way| (*way, *e))) {
        if !arms.contains(&arm) {
            arms.push(arm);
        }
    }
    let seeds = args.chosen_seeds(&[0]);
    let test = split(&family.tasks(), Split::Test);
    if test.is_empty() {
        return Err(Error::input("--task", format!("{:?}", family.name), "a family with test tasks"));
    }
    let standard = |(way, estimator): (&str, Estimator), seed| {
        let usual = GroundingConfig::standard(way, hidden.clone(), &set, seed);
        let mut own = GroundingConfig { estimator, ..usual };
        if args.quick {
            own.checkpoints = vec![5];
        }
        own
    };
    arms.iter().try_for_each(|arm| standard(*arm, 0).validate())?;
    let points = standard(("random", Estimator::default()), 0).checkpoints.len();
    let cells =
        Cells::new(&args.out, seeds.len() * (arms.len() * (1 + points * test.len()) + 2 * test.len()))?;
    let mut rows = Vec::new();
    for seed in &seeds {
        let truth = HiddenWorld::new(hidden.clone())?.reveal();
        let truth = Belief::point(truth.latents, truth.effects)?;
        let trial = Trial { cells: &cells, family, hidden: &hidden, test: &test, truth, seed: *seed };
        let prior = Belief::of_sets(family.prior, std::slice::from_ref(&set), PRIOR_DRAWS, *seed)?;
        rows.push(trial.row(("prior", None), &blank(0), &prior, 0.0)?);
        for (way, estimator) in &arms {
            let config = standard((way, *estimator), *seed);
            let key = format!("{}, {}, seed {seed}", family.name, arm(way, Some(*estimator)));
            let (known, seconds): (Vec<Known>, f64) =
                cells.get(&key, &config, |p| ground(family, &config, p))?;
            for known in &known {
                let belief = Belief::of_draws(known.draws.clone())?;
                rows.push(trial.row((way, Some(*estimator)), known, &belief, seconds)?);
            }
        }
        rows.push(trial.row(("truth", None), &blank(0), &trial.truth, 0.0)?);
    }
    cells.finish();
    let about = json!({"format": "iplw.grounding/1", "version": env!("CARGO_PKG_VERSION"), "family": family.name,
        "hidden": hidden, "set": set, "seeds": seeds, "rows": rows});
    let text = serde_json::to_string_pretty(&about).map_err(|e| Error::Failed(e.to_string()))? + "\n";
    output::write_whole(&args.out.join("grounding.json"), text.as_bytes())?;
    output::write_whole(&args.out.join("table.txt"), table(&rows).as_bytes())?;
    output::print(&table(&rows))
}

/// A way and what reads its trials, for people.
fn arm(way: &str, estimator: Option<Estimator>) -> String {
    match estimator {
        None | Some(Estimator::Posterior) => way.to_string(),
        Some(other) => format!("{way}, {}", other.name()),
    }
}

fn blank(interactions: usize) -> Known {
    Known { interactions, solved: 0, numbers: Vec::new(), converged: true, draws: Vec::new() }
}

/// What is the same for all rows of a seed.
struct Trial<'a> {
    cells: &'a Cells,
    family: &'a Family,
    hidden: &'a HiddenConfig,
    test: &'a [Task],
    truth: Belief,
    seed: u64,
}

impl Trial<'_> {
    /// Plans every test task under a belief and tries the orders.
    fn row(
        &self,
        (way, estimator): (&str, Option<Estimator>),
        known: &Known,
        belief: &Belief,
        seconds: f64,
    ) -> Result<Row> {
        let plan = PlanConfig { rollouts: Some(ROLLOUTS), ..PlanConfig::standard(self.seed) };
        let setup = PlanningConfig { plan, hidden: self.hidden.clone(), predictions: 0 };
        let mut tried: Vec<PlannedTask> = Vec::with_capacity(self.test.len());
        for task in self.test {
            let key = format!(
                "{}, {} with {}, seed {}, {}",
                self.family.name,
                arm(way, estimator),
                known.interactions,
                self.seed,
                task.id
            );
            let depends = json!({"setup": setup, "belief": belief.draws()});
            tried
                .push(self.cells.get(&key, &depends, |p| plan_and_try(task, belief, &setup, &Endless, p))?.0);
        }
        let solved: Vec<Option<usize>> = tried.iter().map(|t| t.solved_at).collect();
        let truth = &self.truth.draws()[0];
        let off = |(name, mean, _): &(String, f64, Option<f64>)| {
            let true_value = truth.number(name).or_else(|| neutral(name))?;
            Some((name.clone(), mean - true_value))
        };
        Ok(Row {
            way: way.into(),
            estimator,
            seed: self.seed,
            interactions: known.interactions,
            solved: known.solved,
            numbers: known.numbers.clone(),
            off: known.numbers.iter().filter_map(off).collect(),
            converged: known.converged,
            first: solved.iter().filter(|s| **s == Some(1)).count() as f64 / solved.len() as f64,
            auccess: Evaluation::of(solved).auccess,
            seconds,
        })
    }
}

/// What a parameter is where its effect is absent.
fn neutral(name: &str) -> Option<f64> {
    EffectParameter::parse(name).ok().map(|p| p.parameter().neutral)
}

/// Rows for people: means over seeds with standard errors, and how far numbers are off (the root of the mean square).
fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "way                    interactions   AUCCESS             first attempt   solved while learning   off by\n",
    );
    let mut kinds: Vec<(String, usize)> = Vec::new();
    for row in rows {
        let own = (row.arm(), row.interactions);
        if !kinds.contains(&own) {
            kinds.push(own);
        }
    }
    for (way, interactions) in kinds {
        let own: Vec<&Row> =
            rows.iter().filter(|r| r.arm() == way && r.interactions == interactions).collect();
        let of = |f: &dyn Fn(&Row) -> f64| Summary::of(&own.iter().map(|r| f(r)).collect::<Vec<_>>());
        let auccess = of(&|r| r.auccess);
        let off = |(name, _): &(String, f64)| {
            let square = |r: &Row| r.off.iter().find(|o| o.0 == *name).map_or(f64::NAN, |o| o.1.powi(2));
            format!("{name} {:.2e}", of(&square).mean.sqrt())
        };
        let off: Vec<String> = own[0].off.iter().map(off).collect();
        text += &format!(
            "{way:<22} {interactions:>12}   {:.3}{:<14} {:>11.0} % {:>19.1}       {}{}\n",
            auccess.mean,
            auccess.standard_error.map_or(String::new(), |e| format!(" +- {e:.3}")),
            100.0 * of(&|r| r.first).mean,
            of(&|r| r.solved as f64).mean,
            off.join(", "),
            if own.iter().all(|r| r.converged) { "" } else { " (not converged)" },
        );
    }
    text
}
