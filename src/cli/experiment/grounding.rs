//! `iplw experiment grounding`: value of a few real interactions for plans, by acquisition method and estimator.

use iplw::budget::Unlimited;
use iplw::commands::effect_set;
use iplw::error::{Error, Result};
use iplw::estimate::ParameterSamples;
use iplw::experiment::estimators::Estimator;
use iplw::experiment::grounding::{GroundingCheckpoint, GroundingConfig, ground};
use iplw::experiment::information_gain::information_gain;
use iplw::experiment::planning::{PlanEvaluation, PlanningConfig, evaluate_plan};
use iplw::plan::PlanConfig;
use iplw::policy::Evaluation;
use iplw::reality::{HiddenConfig, HiddenWorld};
use iplw::task::{Family, Split, Task, family, split};
use iplw::world::{EffectParameter, LINEAR_DRAG};
use serde_json::json;

use super::args::ExperimentArgs;
use super::grounding_report::{GroundingRow, arm, page, table};
use crate::cli::cell_store::CellStore;
use crate::cli::{output, parse};

/// Default acquisition methods.
const ACQUISITION_METHODS: [&str; 5] = ["random", "informative", "probing", "success", "acting"];
/// Maximal number of rollouts per plan.
const MAX_ROLLOUTS_PER_PLAN: usize = 40_000;

pub fn run(args: &ExperimentArgs) -> Result<()> {
    let family = family(&args.task)?;
    let hidden = parse::hidden(&args.effects, args.real.as_deref().unwrap_or(""), family)?;
    let set = effect_set(args.set.as_deref().unwrap_or(LINEAR_DRAG.effect.name));
    let named: Vec<&str> = args.acquisition.iter().flatten().map(String::as_str).collect();
    let ways = if named.is_empty() { ACQUISITION_METHODS.to_vec() } else { named };
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
        CellStore::new(&args.out, seeds.len() * (arms.len() * (1 + points * test.len()) + 2 * test.len()))?;
    let mut rows = Vec::new();
    for seed in &seeds {
        let truth = HiddenWorld::new(hidden.clone())?.reveal();
        let truth = ParameterSamples::point(truth.latents, truth.effects)?;
        let prior = ParameterSamples::standard_prior(family.prior, std::slice::from_ref(&set), *seed)?;
        let about = (family, &hidden, test.as_slice());
        let trial = SeedContext { cells: &cells, about, truth, prior: &prior, seed: *seed };
        rows.push(trial.row(("prior", None), &no_data(0), &prior, 0.0)?);
        for (way, estimator) in &arms {
            let config = standard((way, *estimator), *seed);
            let key = format!("{}, {}, seed {seed}", family.name, arm(way, Some(*estimator)));
            let (known, seconds): (Vec<GroundingCheckpoint>, f64) =
                cells.get_or_compute(&key, &config, |p| ground(family, &config, p))?;
            for known in &known {
                let belief = ParameterSamples::from_draws(known.draws.clone())?;
                rows.push(trial.row((way, Some(*estimator)), known, &belief, seconds)?);
            }
        }
        rows.push(trial.row(("truth", None), &no_data(0), &trial.truth, 0.0)?);
    }
    cells.finish();
    let about = json!({"format": "iplw.grounding/1", "version": env!("CARGO_PKG_VERSION"), "family": family.name,
        "hidden": hidden, "set": set, "seeds": seeds, "rows": rows});
    let text = output::pretty_json(&about)?;
    output::write_whole(&args.out.join("grounding.json"), text.as_bytes())?;
    output::write_whole(&args.out.join("table.txt"), table(&rows).as_bytes())?;
    let page = page(family.name, &set, &rows);
    output::write_whole(&args.out.join("report.html"), page.as_bytes())?;
    output::print(&format!("{}report: {}\n", table(&rows), args.out.join("report.html").display()))
}

fn no_data(interactions: usize) -> GroundingCheckpoint {
    GroundingCheckpoint { interactions, solved: 0, numbers: Vec::new(), converged: true, draws: Vec::new() }
}

/// Data common to all rows of a seed.
struct SeedContext<'a> {
    cells: &'a CellStore,
    /// The family, its hidden world, and the test tasks.
    about: (&'a Family, &'a HiddenConfig, &'a [Task]),
    truth: ParameterSamples,
    prior: &'a ParameterSamples,
    seed: u64,
}

impl SeedContext<'_> {
    /// Plans every test task with parameter samples and evaluates the plans.
    fn row(
        &self,
        (way, estimator): (&str, Option<Estimator>),
        known: &GroundingCheckpoint,
        belief: &ParameterSamples,
        seconds: f64,
    ) -> Result<GroundingRow> {
        let plan = PlanConfig { rollouts: Some(MAX_ROLLOUTS_PER_PLAN), ..PlanConfig::standard(self.seed) };
        let (family, hidden, test) = self.about;
        let setup = PlanningConfig { plan, hidden: hidden.clone(), predictions: 0 };
        let mut tried: Vec<PlanEvaluation> = Vec::with_capacity(test.len());
        for task in test {
            let key = format!(
                "{}, {} with {}, seed {}, {}",
                family.name,
                arm(way, estimator),
                known.interactions,
                self.seed,
                task.id
            );
            let depends = json!({"setup": setup, "belief": belief.draws()});
            tried.push(
                self.cells
                    .get_or_compute(&key, &depends, |p| evaluate_plan(task, belief, &setup, &Unlimited, p))?
                    .0,
            );
        }
        let solved: Vec<Option<usize>> = tried.iter().map(|t| t.solved_at).collect();
        let truth = &self.truth.draws()[0];
        let off = |(name, mean, _): &(String, f64, Option<f64>)| {
            let true_value = truth.value(name).or_else(|| neutral(name))?;
            Some((name.clone(), mean - true_value))
        };
        let names: Vec<String> = known.numbers.iter().map(|(name, ..)| name.clone()).collect();
        Ok(GroundingRow {
            information: information_gain(self.prior.draws(), &known.draws, &names),
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

/// The neutral value of an effect parameter.
fn neutral(name: &str) -> Option<f64> {
    EffectParameter::parse(name).ok().map(|p| p.parameter().neutral)
}
