//! Simulation-based calibration of posteriors: worlds are drawn from the prior and measured; the rank of the true value among the
//! posterior draws must be uniformly distributed.
//!
//! `cargo run --release --example posterior_calibration -- --worlds 100 --out calibration.md`. Each result is appended to a CSV file
//! next to the table, and an interrupted run resumes. `--leave linear_drag:c=0.223` gives every world an effect that the simulation
//! lacks; intervals should then still contain the true value. `--recorded` uses recordings of a thrown ball ([`recordings`]) instead of
//! tasks ([`tasks`]), with random variance components.
//!
//! Source: Talts, Betancourt, Simpson, Vehtari and Gelman, arXiv:1804.06788 (2018). p-values of several parameters are corrected
//! for multiple testing by Holm, Scand. J. Stat. 6 (1979) 65.

mod recordings;
mod tasks;

use std::collections::HashSet;
use std::io::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use iplw::error::Result;
use iplw::estimate::sampler::smc::SmcConfig;
use iplw::inference::posterior::{PosteriorConfig, Sampler, posterior};
use iplw::progress::NoProgress;
use iplw::reality::Trial;
use iplw::task::Scene;

/// Simulation-based calibration: ranks of true values among posterior draws
#[derive(Parser)]
struct Run {
    /// Number of worlds
    #[arg(long, default_value_t = 100)]
    worlds: u64,
    /// First seed
    #[arg(long, default_value_t = 1)]
    first: u64,
    /// Number of trials per world
    #[arg(long, default_value_t = 10)]
    trials: usize,
    /// Task family
    #[arg(long, default_value = "bowling")]
    task: String,
    /// Standard deviation of the measurement noise, m; only positions are observed
    #[arg(long, default_value_t = 0.005)]
    noise: f64,
    /// Effect of every world that the simulation lacks, `name:parameter=value`
    #[arg(long)]
    leave: Option<String>,
    /// Use recordings of throws, with random discrepancy and between-trial variation, instead of tasks
    #[arg(long, conflicts_with_all = ["leave", "task", "sample_discrepancy"])]
    recorded: bool,
    /// Assume that the model is complete
    #[arg(long)]
    no_discrepancy: bool,
    /// Sample the model discrepancy
    #[arg(long, conflicts_with = "no_discrepancy")]
    sample_discrepancy: bool,
    /// Number of particles of each of the four runs
    #[arg(long, default_value_t = 256)]
    particles: usize,
    /// Output file of the table
    #[arg(long, default_value = "calibration.md")]
    out: PathBuf,
}

/// A world drawn from the prior, with its measurements.
struct SampledWorld {
    scene: Scene,
    trials: Vec<Trial>,
    /// Effects to estimate.
    set: Vec<String>,
    /// True values of the posterior's parameters.
    truth: Vec<f64>,
}

/// Number of bins of the rank histogram.
const BINS: usize = 10;
/// Number of thinned draws for ranking: 99, so that there are 100 possible ranks.
const RANKED_DRAWS: usize = 99;

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let run = Run::parse();
    let log = run.out.with_extension("csv");
    let text = std::fs::read_to_string(&log).unwrap_or_default();
    let done: HashSet<&str> = text.lines().filter_map(|l| l.split(',').next()).collect();
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(&log)?;
    for seed in run.first..run.first + run.worlds {
        let lacks = match (run.no_discrepancy, run.sample_discrepancy) {
            (true, _) => "complete",
            (_, true) => "followed",
            _ => "field",
        };
        let left = if run.recorded { "recordings" } else { "nothing" };
        // Commas separate the columns of the log.
        let left = run.leave.as_deref().unwrap_or(left).replace(',', ";");
        let key = format!("{left}/{lacks}/{seed}");
        if !done.contains(key.as_str()) {
            let line = world(&run, seed)?;
            file.write_all(format!("{key},{line}\n").as_bytes())?;
        }
    }
    drop(file);
    let table = table(&std::fs::read_to_string(&log)?);
    print!("{table}");
    std::fs::write(&run.out, table)?;
    Ok(())
}

/// Row of a world: rank and spread of each parameter, then convergence and duration.
fn world(run: &Run, seed: u64) -> Result<String> {
    let begun = Instant::now();
    let usual = PosteriorConfig::standard(seed);
    let drawn = if run.recorded {
        recordings::sample_world(run, seed)
    } else {
        tasks::sample_world(run, &usual.prior, seed)
    };
    let SampledWorld { scene, trials, set, truth } = drawn?;
    let sampler = Sampler::Smc(SmcConfig { particles: run.particles, ..SmcConfig::standard(seed) });
    let (discrepancy, follow) = (!run.no_discrepancy, run.sample_discrepancy);
    let config =
        PosteriorConfig { sampler, sets: vec![set], discrepancy, sample_discrepancy: follow, ..usual };
    let found = posterior(&scene, &trials, &config, &NoProgress)?;
    let draws = &found.sets[0].draws;
    let of = |(k, truth): (usize, &f64)| {
        let all: Vec<f64> = draws.points.iter().map(|p| p[k]).collect();
        let thinned = (0..RANKED_DRAWS).map(|i| all[i * all.len() / RANKED_DRAWS]);
        let rank = thinned.filter(|v| v < truth).count();
        let mut sorted = all.clone();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted[(share * (sorted.len() - 1) as f64).round() as usize];
        let held = (at(0.05)..=at(0.95)).contains(truth);
        format!("{rank},{},{:.3e},{:.3e}", u8::from(held), at(0.5) - truth, at(0.95) - at(0.05))
    };
    let ranks: Vec<String> = truth.iter().enumerate().map(of).collect();
    let converged = u8::from(draws.quality.verdict().is_ok());
    let lacks = 1.0 - found.sets[0].fields[0].1;
    Ok(format!("{},{converged},{lacks:.3},{:.1}", ranks.join(","), begun.elapsed().as_secs_f64()))
}

/// Table by parameter: coverage of 90 % intervals, and a test of uniform ranks.
fn table(log: &str) -> String {
    let rows: Vec<Vec<&str>> = log.lines().map(|l| l.split(',').collect()).collect();
    let mut kinds: Vec<&str> = rows.iter().filter_map(|r| r[0].rsplit_once('/')).map(|k| k.0).collect();
    kinds.sort_unstable();
    kinds.dedup();
    let mut out = String::from(
        "| left out / taken for | number | worlds | 90 % intervals hold | chi squared of ranks (9 degrees) | p | median width | converged | s |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for kind in kinds {
        let own: Vec<&Vec<&str>> =
            rows.iter().filter(|r| r[0].rsplit_once('/').is_some_and(|k| k.0 == kind)).collect();
        let number = |r: &Vec<&str>, i: usize| r[i].parse::<f64>().unwrap_or(f64::NAN);
        let mean = |i: usize| own.iter().map(|r| number(r, i)).sum::<f64>() / own.len() as f64;
        let names: &[&str] =
            if kind.starts_with("recordings") { &recordings::PARAMETERS } else { &tasks::PARAMETERS };
        // After the parameters: convergence, discrepancy, seconds.
        let rest = 1 + 4 * names.len();
        for (k, name) in names.iter().enumerate() {
            let first = 1 + 4 * k;
            let mut counts = [0.0; BINS];
            own.iter().for_each(|r| {
                counts[((number(r, first) as usize) * BINS / (RANKED_DRAWS + 1)).min(BINS - 1)] += 1.0
            });
            let wanted = own.len() as f64 / BINS as f64;
            let chi: f64 = counts.iter().map(|c| (c - wanted).powi(2) / wanted).sum();
            let mut widths: Vec<f64> = own.iter().map(|r| number(r, first + 3)).collect();
            widths.sort_by(f64::total_cmp);
            out += &format!(
                "| {kind} | {name} | {} | {:.1} % | {chi:.1} ({}) | {:.4} | {:.2e} | {:.0} % | {:.1} |\n",
                own.len(),
                100.0 * mean(first + 1),
                counts.map(|c| format!("{c}")).join(" "),
                chi_squared_tail(chi, (BINS - 1) as f64),
                widths[widths.len() / 2],
                100.0 * mean(rest),
                mean(rest + 2)
            );
        }
    }
    out
}

/// P(chi squared > `x`), by the F distribution with a very large number of denominator degrees of freedom.
fn chi_squared_tail(x: f64, degrees: f64) -> f64 {
    iplw::distribution::f_survival(x / degrees, degrees, 1e7)
}
