//! `iplw design`: the most informative experiment about a question.

use std::path::{Path, PathBuf};

use iplw::commands::{DesignRequest, design_experiments};
use iplw::design::{DesignDocument, rounded_cost};
use iplw::error::Result;
use iplw::estimate::ParameterSamples;
use iplw::report;

use super::compact_json::compact_json;
use super::{output, parse};

/// Recommend the most informative experiment (about latents, effects, or whether plans work).
///
/// Recommends the most informative experiment about a question. Candidate actions are simulated in worlds sampled from the prior or
/// posterior and ranked by their expected information gain.
#[derive(clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    request: DesignRequest,
    /// Posterior samples (iplw.posterior/2) [default: the family's prior]
    #[arg(long, value_name = "FILE", conflicts_with = "sets")]
    posterior: Option<PathBuf>,
    /// Output directory for design.json and report.html [default: none]
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
    let (tasks, family) = parse::tasks(&args.request.task)?;
    let config = args.request.config()?;
    let samples = match &args.posterior {
        Some(path) => parse::parameter_samples(path)?,
        None => {
            let sets = args.request.sets()?;
            ParameterSamples::standard_prior(family.prior, &sets, config.seed)?
        }
    };
    args.out.as_deref().map_or(Ok(()), |out| output::prepare_directory("--out", out))?;
    let bar = output::TerminalProgress::new();
    let document = design_experiments(&tasks, &samples, &config, &bar)?;
    bar.clear();
    let text = compact_json(&document)? + "\n";
    if let Some(out) = &args.out {
        output::write_whole(&out.join("design.json"), text.as_bytes())?;
        let page = report::design::report(&document).to_html();
        output::write_whole(&out.join("report.html"), page.as_bytes())?;
    }
    output::print(&if args.json { text } else { summary(&document, args.out.as_deref()) })
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
