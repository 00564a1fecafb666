//! `iplw design`: the most informative experiment about a question.

use std::path::{Path, PathBuf};

use iplw::design::{
    Costs, DesignConfig, DesignDocument, Question, design, document, rounded_cost, training_and_test_tasks,
};
use iplw::error::Result;
use iplw::estimate::ParameterSamples;
use iplw::estimate::parameter_samples::PRIOR_SAMPLE_COUNT;
use iplw::task::DEFAULT_FAMILY;
use iplw::world::Engine;

use super::compact_json::compact_json;
use super::{output, parse};

/// Recommend the most informative experiment (about latents, effects, or whether plans work).
///
/// Recommends the most informative experiment about a question. Candidate actions are simulated in worlds sampled from the prior or
/// posterior and ranked by their expected information gain.
#[derive(clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub struct Args {
    /// Family, whose training tasks are used, or a task such as bowling:017.
    #[arg(long, default_value = DEFAULT_FAMILY)]
    task: String,
    /// Question: latents (and effect parameters), effects (which set), or success (of plans for test tasks).
    #[arg(long, default_value = "latents")]
    question: String,
    /// Posterior samples (iplw.posterior/2) [default: the family's prior]
    #[arg(long, value_name = "FILE", conflicts_with = "sets")]
    posterior: Option<PathBuf>,
    /// Effects of the prior, joined by +; repeat for several sets of equal probability [default: none]
    #[arg(long = "set", value_name = "EFFECTS")]
    sets: Vec<String>,
    /// Standard deviation of an observed position, m.
    #[arg(long, default_value_t = 0.005)]
    noise: f64,
    /// Number of experiments in the batch [default: 1; with --budget, as many as it allows]
    #[arg(long)]
    batch: Option<usize>,
    /// Cost of an experiment, in the unit of the budget (minutes, say).
    #[arg(long, value_name = "COST", default_value_t = 1.0)]
    trial_cost: f64,
    /// Additional cost for setting up each task of the batch.
    #[arg(long, value_name = "COST", default_value_t = 0.0)]
    setup_cost: f64,
    /// Maximal cost of the batch [default: unlimited]
    #[arg(long, value_name = "COST")]
    budget: Option<f64>,
    /// Number of random candidate actions [default: 400]
    #[arg(long)]
    candidates: Option<usize>,
    /// Number of best candidates evaluated in more worlds [default: 24]
    #[arg(long)]
    shortlist: Option<usize>,
    /// Number of worlds for the shortlist [default: 128]
    #[arg(long)]
    worlds: Option<usize>,
    /// Perturbed copies of an action for the actuation noise [default: 4]
    #[arg(long)]
    copies: Option<usize>,
    /// Maximal perturbation of an action component, in [0, 1].
    #[arg(long, default_value_t = iplw::reality::certify::MAX_PERTURBATION)]
    perturb: f64,
    /// Physics engine: auto, rapier or lanes.
    #[arg(long, default_value = "auto")]
    engine: String,
    /// Random seed.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Output directory for design.json [default: none]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  The best first measurement for friction and restitution:
    iplw design --task bowling
  Discriminate between air drag and rolling resistance:
    iplw design --task bowling --question effects --set none --set linear_drag --set rolling_resistance
  Five experiments that predict whether plans for the test tasks will work, given a posterior:
    iplw design --task bowling --question success --posterior known/posterior.json --batch 5 --out next
  As many as fit into an hour, if a trial takes two minutes and setting up a task ten more:
    iplw design --task bowling --trial-cost 2 --setup-cost 10 --budget 60 --out next";

pub fn run(args: &Args) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.task)?;
    let config = config(args)?;
    let samples = match &args.posterior {
        Some(path) => parse::parameter_samples(path)?,
        None => {
            let sets: Vec<Vec<String>> = args.sets.iter().map(|s| parse::set(s)).collect();
            ParameterSamples::prior_over_sets(family.prior, &sets, PRIOR_SAMPLE_COUNT, args.seed)?
        }
    };
    args.out.as_deref().map_or(Ok(()), |out| output::prepare_directory("--out", out))?;
    let (training, asked) = training_and_test_tasks(&tasks);
    let bar = output::TerminalProgress::new();
    let found = design(&training, &asked, &samples, &config, &bar)?;
    bar.clear();
    let document = document(&found, &config);
    let text = compact_json(&document)? + "\n";
    if let Some(out) = &args.out {
        output::write_whole(&out.join("design.json"), text.as_bytes())?;
    }
    output::print(&if args.json { text } else { summary(&document, args.out.as_deref()) })
}

fn config(args: &Args) -> Result<DesignConfig> {
    let usual = DesignConfig::standard(Question::from_name(&args.question)?, args.seed);
    let candidates = args.candidates.unwrap_or(usual.candidates);
    let shortlist = args.shortlist.unwrap_or(usual.shortlist.max(args.batch.unwrap_or(1)));
    // With a budget, as many as it allows.
    let most = args.budget.map_or(usual.batch, |_| shortlist.min(candidates));
    let config = DesignConfig {
        candidates,
        shortlist,
        worlds: [usual.worlds[0], args.worlds.unwrap_or(usual.worlds[1])],
        copies: args.copies.unwrap_or(usual.copies),
        perturb: args.perturb,
        noise: args.noise,
        batch: args.batch.unwrap_or(most),
        costs: Costs { trial: args.trial_cost, setup: args.setup_cost, budget: args.budget },
        engine: Engine::from_name(&args.engine)?,
        ..usual
    };
    config.validate()?;
    Ok(config)
}

/// Text for a terminal.
fn summary(d: &DesignDocument, out: Option<&Path>) -> String {
    let mut text = format!("{} candidates, {} rollouts\n", d.candidates, d.rollouts);
    for (i, e) in d.experiments.iter().enumerate() {
        let action = e.action.iter().map(|v| format!("{v:.4}")).collect::<Vec<_>>().join(", ");
        text += &format!(
            "{}. {} [{action}]: {:.2} +- {:.2} nats{}\n   {}\n",
            i + 1,
            e.task,
            e.gain.information,
            e.gain.standard_error,
            e.adds.filter(|_| i > 0).map_or(String::new(), |a| format!(", {a:+.2} beyond the previous ones")),
            e.reason
        );
    }
    if d.experiments.len() > 1 {
        let cost = if d.config.costs.is_uniform() {
            String::new()
        } else {
            format!(", for {}", rounded_cost(d.cost))
        };
        text += &format!(
            "together {:.2} +- {:.2} nats{cost}\n",
            d.together.information, d.together.standard_error
        );
    }
    text + &out.map_or(String::new(), |out| format!("design: {}\n", out.join("design.json").display()))
}
