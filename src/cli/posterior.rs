//! `iplw posterior`: what is known of latents and effects, from measured trials.

use std::path::{Path, PathBuf};

use iplw::discover::posterior::{Document, PosteriorConfig, Wanted, posterior};
use iplw::error::{Error, Result};
use iplw::picture::plot::{Heatmap, heatmaps};
use iplw::picture::report::{Block, Report, Section};
use iplw::reality::Gathered;
use iplw::world::Engine;
use iplw::world::latent::factor_index;

use super::layout::laid_out;
use super::{output, parse, tracks};

/// Draws what is known of a scene's latents, and of effects' parameters, from the posterior given measured trials: how sure it
/// is, how the numbers go together, and whether anything is left that the model lacks (draws allow for that).
/// Writes posterior.json (iplw.posterior/1; draws are columns) and report.html with a plot of every pair.
#[derive(clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    tracks: tracks::Tracks,
    #[command(flatten)]
    sampling: Sampling,
    /// Directory for the result.
    #[arg(long)]
    out: PathBuf,
    /// Print the document as JSON.
    #[arg(long)]
    json: bool,
}

/// What a posterior is of, and how it is drawn.
#[derive(clap::Args)]
pub struct Sampling {
    /// A set of effects beside the scene's own, joined by +, whose parameters are to be known too (see `iplw effects`); repeated,
    /// sets are weighed by how they predict trials from the others. `none` is the scene as it is, which is the default.
    #[arg(long = "set", value_name = "EFFECTS", help_heading = SAMPLING)]
    sets: Vec<String>,
    /// Latents to be known, instead of those that the scene says (its "calibrate").
    #[arg(long, value_delimiter = ',', value_name = "LATENT,..", help_heading = SAMPLING)]
    calibrate: Vec<String>,
    /// What is believed of a latent beforehand, mean and standard deviation: `friction=0.5:0.25`; may be repeated. Else 1:0.5, for
    /// restitution 0.5:0.25.
    #[arg(long, value_name = "LATENT=MEAN:SD", help_heading = SAMPLING)]
    prior: Vec<String>,
    /// smc (sequential Monte Carlo) or mcmc (Markov chains).
    #[arg(long, default_value = "smc", help_heading = SAMPLING)]
    method: String,
    /// Draws in all.
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u64).range(64..=100_000), help_heading = SAMPLING)]
    draws: u64,
    /// Take the model for complete: nothing is allowed for that trials share and the model lacks.
    #[arg(long, help_heading = SAMPLING)]
    no_discrepancy: bool,
    /// Where trials share something that the model lacks, draw it along as a force field: less is known then, and mostly truly, a minute or more
    /// later. Naming the effect (`iplw diagnose`, then `--set`) is better and faster, where it has a name.
    #[arg(long, conflicts_with = "no_discrepancy", help_heading = SAMPLING)]
    follow: bool,
    /// Engine of the simulation.
    #[arg(long, default_value = "auto", help_heading = SAMPLING)]
    engine: String,
    /// Seed of the draws.
    #[arg(long, default_value_t = 0, help_heading = SAMPLING)]
    seed: u64,
}

const SAMPLING: &str = "What is to be known, and how it is drawn";
const EXAMPLES: &str = "\
Examples:
  Friction and restitution of a hidden world, from 50 trials seen with 5 mm of noise:
    iplw measure --task bowling --noise 0.005 --trials 50 --out measured
    iplw posterior --scene measured/scene.json --trials measured/trials.csv --out known
  The same if air may hold balls back, and which of two laws does:
    iplw posterior --scene measured/scene.json --trials measured/trials.csv --set linear_drag --set quadratic_drag --out known
  Then what to do with it:
    iplw plan --task bowling:003 --belief known/posterior.json
    iplw train --task bowling --belief known/posterior.json --out policy.safetensors";

pub fn run(args: &Args) -> Result<()> {
    let Gathered { mut scene, trials, .. } = tracks::read(&args.tracks)?;
    if !args.sampling.calibrate.is_empty() {
        args.sampling.calibrate.iter().try_for_each(|n| factor_index(n).map(drop))?;
        scene.calibrate.clone_from(&args.sampling.calibrate);
    }
    let config = args.sampling.config()?;
    output::directory("--out", &args.out)?;
    let bar = output::Bar::new();
    let document = Document::new(&posterior(&scene, &trials, &config, &bar)?, &config);
    bar.clear();
    write(&args.out, &document)?;
    if args.json {
        return output::print(&(laid_out(&document)? + "\n"));
    }
    output::print(&told(&args.out, &document))
}

/// Writes a posterior into a directory.
pub fn write(out: &Path, document: &Document) -> Result<()> {
    output::directory("--out", out)?;
    output::write_whole(&out.join("posterior.json"), (laid_out(document)? + "\n").as_bytes())?;
    output::write_whole(&out.join("report.html"), report(document).to_html().as_bytes())
}

/// What a posterior holds, and where it was written.
pub fn told(out: &Path, document: &Document) -> String {
    format!("{}draws: {}\n", summary(document), out.join("posterior.json").display())
}

impl Sampling {
    /// The configuration that the options ask for.
    fn config(&self) -> Result<PosteriorConfig> {
        let believed = |given: &String| {
            let wrong =
                || Error::input("--prior", format!("{given:?}"), "LATENT=MEAN:SD, such as friction=0.5:0.25");
            let (name, rest) = given.split_once('=').ok_or_else(wrong)?;
            let (mean, sd) = rest.split_once(':').ok_or_else(wrong)?;
            let number = |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(wrong);
            Ok((name.trim().to_string(), [number(mean)?, number(sd)?]))
        };
        let wanted = Wanted {
            sets: self.sets.iter().map(|s| parse::set(s)).collect(),
            prior: self.prior.iter().map(believed).collect::<Result<_>>()?,
            method: Some(self.method.clone()),
            draws: Some(self.draws as usize),
            discrepancy: Some(!self.no_discrepancy),
            follow: self.follow,
            engine: Engine::from_name(&self.engine)?,
            seed: self.seed,
        };
        wanted.config()
    }
}

/// For a terminal.
fn summary(d: &Document) -> String {
    let evaluations: u64 = d.sets.iter().map(|s| s.evaluations).sum();
    let mut text = format!(
        "{} of {} trials, {} draws by {}, {evaluations} likelihoods\n{:<28} {:>10} {:>10}   95 % interval\n",
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
        let told = if p.identifiable { "" } else { "   as believed beforehand: the trials do not tell it" };
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
        text += &format!("\n{:<40} {:>8} {:>14} {:>14}\n", "set", "weight", "log predictive", "log evidence");
        for s in &d.sets {
            let evidence = s.log_evidence.map_or("-".into(), |[mean, _]| format!("{mean:.1}"));
            text += &format!(
                "{:<40} {:>8.4} {:>14.1} {evidence:>14}\n",
                named(&s.effects),
                s.weight,
                s.predictive
            );
        }
    }
    for warning in &d.warnings {
        text += &format!("note: {warning}\n");
    }
    let fewest = d.sets.iter().flat_map(|s| &s.quality.effective).copied().fold(f64::INFINITY, f64::min);
    let worst = d.sets.iter().flat_map(|s| &s.quality.r_hat).copied().fold(1.0, f64::max);
    text + &format!(
        "{}: at least {fewest:.0} effective draws, R-hat at most {worst:.3}\n",
        if d.converged { "converged" } else { "NOT converged" }
    )
}

fn named(set: &[String]) -> String {
    if set.is_empty() { "the scene as it is".into() } else { set.join(" + ") }
}

/// The page: a table and a plot of every pair.
fn report(d: &Document) -> Report {
    let pairs = pairs(d);
    let rows = pairs
        .chunks(BESIDE)
        .map(|maps| Block::Svg { svg: heatmaps("How many draws lie where", maps), caption: String::new() });
    let known = Section { heading: "What is known".into(), blocks: vec![Block::Code(summary(d))] };
    let pictures = Section { heading: "How numbers go together".into(), blocks: rows.collect() };
    let sections = if pairs.is_empty() { vec![known] } else { vec![known, pictures] };
    let lead = match d.warnings.as_slice() {
        [] => "Draws from the posterior of latents and effects, given the trials.".to_string(),
        all => all.join("\n\n"),
    };
    Report { title: "What is known".into(), lead, sections }
}

/// Cells of a map along an axis.
const CELLS: usize = 24;
/// Most maps, and how many stand side by side.
const MAPS: usize = 15;
const BESIDE: usize = 3;

/// A map of how many draws lie where, for every two numbers.
fn pairs(d: &Document) -> Vec<Heatmap> {
    let columns: Vec<(&String, &Vec<Option<f64>>)> = d.columns.iter().collect();
    let pairs = (0..columns.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
    pairs.take(MAPS).map(|(i, j)| map(columns[i], columns[j])).collect()
}

fn map(x: (&String, &Vec<Option<f64>>), y: (&String, &Vec<Option<f64>>)) -> Heatmap {
    let both: Vec<[f64; 2]> = x.1.iter().zip(y.1).filter_map(|(x, y)| Some([(*x)?, (*y)?])).collect();
    let ends = |k: usize| {
        let all = || both.iter().map(|p| p[k]);
        let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        [low, if high > low { high } else { low + 1e-9 }]
    };
    let (ex, ey) = (ends(0), ends(1));
    let cell =
        |v: f64, [low, high]: [f64; 2]| (((v - low) / (high - low) * CELLS as f64) as usize).min(CELLS - 1);
    let mut values = vec![vec![0.0; CELLS]; CELLS];
    both.iter().for_each(|[x, y]| values[cell(*y, ey)][cell(*x, ex)] += 1.0);
    let centres = |[low, high]: [f64; 2]| {
        (0..CELLS).map(|i| low + (high - low) * (i as f64 + 0.5) / CELLS as f64).collect::<Vec<f64>>()
    };
    Heatmap {
        x_label: x.0.clone(),
        y_label: y.0.clone(),
        x: centres(ex),
        y: centres(ey),
        values,
        value_label: "draws".into(),
        ..Heatmap::default()
    }
}
