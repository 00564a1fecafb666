//! `iplw design`: which experiment would tell the most about a question.

use std::path::{Path, PathBuf};

use iplw::design::{Costs, DesignConfig, DesignDocument, Question, design, document, parts, shown_cost};
use iplw::error::Result;
use iplw::estimate::Belief;
use iplw::estimate::belief::PRIOR_DRAWS;
use iplw::task::DEFAULT_FAMILY;
use iplw::world::Engine;

use super::layout::laid_out;
use super::{output, parse};

/// Says which experiment would tell the most about a question, and why: candidate actions are done in simulation in worlds drawn from
/// what is believed, and ranked by the information that what would be seen is expected to bring.
#[derive(clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub struct Args {
    /// A family, on whose training tasks actions are looked for, or one task such as bowling:017.
    #[arg(long, default_value = DEFAULT_FAMILY)]
    task: String,
    /// latents (how large they are, and effects' parameters), effects (which of the belief's sets the world has), success (whether
    /// what is planned for the test tasks solves them).
    #[arg(long, default_value = "latents")]
    question: String,
    /// What is believed: draws of a posterior (`iplw.posterior/1`). Else the family's prior.
    #[arg(long, value_name = "FILE", conflicts_with = "sets")]
    belief: Option<PathBuf>,
    /// Of the prior: a set of effects that the world may have, joined by +, as large as they usually are; repeated, sets are equally
    /// likely. `none` is the scene as it is, which is the default.
    #[arg(long = "set", value_name = "EFFECTS")]
    sets: Vec<String>,
    /// Standard deviation with which a position is seen, m.
    #[arg(long, default_value_t = 0.005)]
    noise: f64,
    /// Experiments to choose, together; 1 if neither this nor a budget is given.
    #[arg(long)]
    batch: Option<usize>,
    /// What an experiment costs, in the unit of the budget (minutes, say): those are chosen that tell most for their cost.
    #[arg(long, value_name = "COST", default_value_t = 1.0)]
    trial_cost: f64,
    /// What it costs more to set a task up, once for every task of the batch.
    #[arg(long, value_name = "COST", default_value_t = 0.0)]
    setup_cost: f64,
    /// Most that the batch may cost; `--batch` is then the most experiments, as many as are looked at closely if it is not given.
    #[arg(long, value_name = "COST")]
    budget: Option<f64>,
    /// Random actions that are looked at.
    #[arg(long)]
    candidates: Option<usize>,
    /// So many of the best are looked at closely.
    #[arg(long)]
    shortlist: Option<usize>,
    /// Worlds in which the best are looked at.
    #[arg(long)]
    worlds: Option<usize>,
    /// Copies of an action whose spread counts as noise.
    #[arg(long)]
    copies: Option<usize>,
    /// Most that a component of an action, in [0, 1], is moved in a copy, as by a trembling hand.
    #[arg(long, default_value_t = iplw::reality::certify::PERTURBATION)]
    perturb: f64,
    /// Engine that simulates: auto, rapier or lanes.
    #[arg(long, default_value = "auto")]
    engine: String,
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Directory for design.json.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  What to measure first, to know friction and restitution:
    iplw design --task bowling
  Is it air that holds balls back, or rolling?
    iplw design --task bowling --question effects --set none --set linear_drag --set rolling_resistance
  Five experiments that together tell whether plans for the test tasks will work, after a posterior:
    iplw design --task bowling --question success --belief known/posterior.json --batch 5 --out next
  As many as can be had for an hour, where a trial takes two minutes and another scene ten more:
    iplw design --task bowling --trial-cost 2 --setup-cost 10 --budget 60 --out next";

pub fn run(args: &Args) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.task)?;
    let config = config(args)?;
    let belief = match &args.belief {
        Some(path) => parse::belief(path)?,
        None => {
            let sets: Vec<Vec<String>> = args.sets.iter().map(|s| parse::set(s)).collect();
            Belief::of_sets(family.prior, &sets, PRIOR_DRAWS, args.seed)?
        }
    };
    args.out.as_deref().map_or(Ok(()), |out| output::directory("--out", out))?;
    let (training, asked) = parts(&tasks);
    let bar = output::Bar::new();
    let found = design(&training, &asked, &belief, &config, &bar)?;
    bar.clear();
    let document = document(&found, &config);
    let text = laid_out(&document)? + "\n";
    if let Some(out) = &args.out {
        output::write_whole(&out.join("design.json"), text.as_bytes())?;
    }
    output::print(&if args.json { text } else { told(&document, args.out.as_deref()) })
}

fn config(args: &Args) -> Result<DesignConfig> {
    let usual = DesignConfig::standard(Question::from_name(&args.question)?, args.seed);
    let candidates = args.candidates.unwrap_or(usual.candidates);
    let shortlist = args.shortlist.unwrap_or(usual.shortlist.max(args.batch.unwrap_or(1)));
    // Of a budget as many as it pays for.
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

/// For a terminal.
fn told(d: &DesignDocument, out: Option<&Path>) -> String {
    let mut text = format!("{} candidates, {} rollouts\n", d.candidates, d.rollouts);
    for (i, e) in d.experiments.iter().enumerate() {
        let action = e.action.iter().map(|v| format!("{v:.4}")).collect::<Vec<_>>().join(", ");
        text += &format!(
            "{}. {} [{action}]: {:.2} +- {:.2} nats{}\n   {}\n",
            i + 1,
            e.task,
            e.gain.information,
            e.gain.standard_error,
            e.adds.filter(|_| i > 0).map_or(String::new(), |a| format!(", {a:+.2} over those before")),
            e.reason
        );
    }
    if d.experiments.len() > 1 {
        let cost =
            if d.config.costs.alike() { String::new() } else { format!(", for {}", shown_cost(d.cost)) };
        text += &format!(
            "together {:.2} +- {:.2} nats{cost}\n",
            d.together.information, d.together.standard_error
        );
    }
    text + &out.map_or(String::new(), |out| format!("design: {}\n", out.join("design.json").display()))
}
