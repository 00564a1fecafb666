//! `iplw posterior`: posterior samples of latents and effect parameters, from measured trials.

use std::path::{Path, PathBuf};

use iplw::commands::{PosteriorRequest, set_calibrate};
use iplw::error::Result;
use iplw::inference::posterior::{self as sampling, PosteriorDocument};
use iplw::reality::LoadedTrials;
use iplw::report::posterior;

use super::compact_json::compact_json;
use super::{output, track_options};

/// Sample the posterior of latents and effect parameters, given measured trials.
///
/// Samples the posterior of a scene's latents and of effect parameters given measured trials, with an allowance for model discrepancy.
/// Writes posterior.json (iplw.posterior/2, samples as columns) and report.html with pair plots.
#[derive(clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    tracks: track_options::TrackOptions,
    #[command(flatten, next_help_heading = "Model and sampler")]
    request: PosteriorRequest,
    /// Output directory.
    #[arg(long, help_heading = None::<&str>)]
    out: PathBuf,
    /// Print the document as JSON.
    #[arg(long, help_heading = None::<&str>)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  Friction and restitution of a hidden world, from 50 trials with 5 mm of noise:
    iplw measure --task bowling --noise 0.005 --trials 50 --out measured
    iplw posterior --scene measured/scene.json --trials measured/trials.csv --out known
  The same with air drag by one of two laws:
    iplw posterior --scene measured/scene.json --trials measured/trials.csv --set linear_drag --set quadratic_drag --out known
  Use the result:
    iplw plan --task bowling:003 --posterior known/posterior.json
    iplw train --task bowling --posterior known/posterior.json --out policy.safetensors";

pub fn run(args: &Args) -> Result<()> {
    let config = args.request.config().map_err(track_options::as_options::<PosteriorRequest>)?;
    let LoadedTrials { mut scene, trials, .. } = track_options::read(&args.tracks)?;
    set_calibrate(&mut scene, args.request.calibrate.clone())?;
    output::prepare_directory("--out", &args.out)?;
    let bar = output::TerminalProgress::new();
    let document = PosteriorDocument::new(&sampling::posterior(&scene, &trials, &config, &bar)?, &config);
    bar.clear();
    write(&args.out, &document)?;
    if args.json {
        return output::print(&(compact_json(&document)? + "\n"));
    }
    output::print(&summary_with_path(&args.out, &document))
}

/// Writes a posterior into a directory.
pub fn write(out: &Path, document: &PosteriorDocument) -> Result<()> {
    output::prepare_directory("--out", out)?;
    output::write_whole(&out.join("posterior.json"), (compact_json(document)? + "\n").as_bytes())?;
    output::write_whole(&out.join("report.html"), posterior::report(document).to_html().as_bytes())
}

/// Summary of a posterior, and its path.
pub fn summary_with_path(out: &Path, document: &PosteriorDocument) -> String {
    format!("{}samples: {}\n", summary(document), out.join("posterior.json").display())
}

/// Text for a terminal.
fn summary(d: &PosteriorDocument) -> String {
    let evaluations: u64 = d.sets.iter().map(|s| s.evaluations).sum();
    let mut text = format!(
        "{} of {} trials, {} samples by {}, {evaluations} likelihood evaluations\n{:<28} {:>10} {:>10}   95 % interval\n",
        d.trials[0],
        d.trials[1],
        d.run.len(),
        d.method(),
        "",
        "mean",
        "sd"
    );
    for p in &d.parameters {
        let name = p.setting.as_ref().map_or_else(|| p.name.clone(), |s| format!("{} ({s})", p.name));
        let told =
            if p.identifiable { "" } else { "   equal to the prior: not identifiable from these trials" };
        text += &format!(
            "{:<28} {:>10.5} {:>10.5}   {:.5} to {:.5} {}{told}\n",
            name,
            p.mean,
            p.sd,
            p.quantiles[0],
            p.quantiles[6],
            if p.unit == "1" { "" } else { &p.unit }
        );
    }
    if d.sets.len() > 1 {
        text += &format!("\n{:<40} {:>8} {:>14} {:>14}\n", "set", "weight", "log evidence", "sampled");
        for s in &d.sets {
            let evidence = s.log_evidence.map_or("-".into(), |[mean, _]| format!("{mean:.1}"));
            text += &format!(
                "{:<40} {:>8.4} {:>14.1} {evidence:>14}\n",
                set_name(&s.effects),
                s.weight,
                s.laplace_log_evidence
            );
        }
    }
    for warning in &d.warnings {
        text += &format!("note: {warning}\n");
    }
    let fewest = d.sets.iter().flat_map(|s| &s.quality.effective).copied().fold(f64::INFINITY, f64::min);
    let worst = d.sets.iter().flat_map(|s| &s.quality.r_hat).copied().fold(1.0, f64::max);
    text + &format!(
        "{}: effective sample size at least {fewest:.0}, R-hat at most {worst:.3}\n",
        if d.converged { "converged" } else { "NOT converged" }
    )
}

fn set_name(set: &[String]) -> String {
    if set.is_empty() { "the scene without additional effects".into() } else { set.join(" + ") }
}
