//! Simulation-based calibration of posteriors: worlds are drawn from the prior, measured, and asked; where the truth ranks among
//! the draws must be anything, equally often.
//!
//! `cargo run --release --example posterior_calibration -- --worlds 100 --out calibration.md`. Every world's outcome is added to a CSV
//! beside the table as soon as it is known, and a run that was stopped goes on where it was. `--leave linear_drag:c=0.223` gives every
//! world an effect that the simulation lacks: then intervals should still hold the truth. `--recorded` draws recordings of a ball that is
//! thrown in place of tasks ([`recordings`]; else [`tasks`]): there variance components are drawn with what is asked.
//!
//! Source: Talts, Betancourt, Simpson, Vehtari and Gelman, arXiv:1804.06788 (2018); p values of several numbers are corrected
//! as Holm, Scand. J. Stat. 6 (1979) 65.

mod recordings;
mod tasks;

use std::collections::HashSet;
use std::io::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use iplw::discover::posterior::{PosteriorConfig, Sampler, posterior};
use iplw::error::Result;
use iplw::estimate::sampler::smc::SmcConfig;
use iplw::progress::Silent;
use iplw::reality::Trial;
use iplw::task::Scene;

/// Draws worlds from the prior and counts where the truth ranks among draws from the posterior
#[derive(Parser)]
struct Run {
    /// How many worlds
    #[arg(long, default_value_t = 100)]
    worlds: u64,
    /// The first of the seeds
    #[arg(long, default_value_t = 1)]
    first: u64,
    /// Trials of a world
    #[arg(long, default_value_t = 10)]
    trials: usize,
    /// The family whose tasks are acted in
    #[arg(long, default_value = "bowling")]
    task: String,
    /// Standard deviation of what is seen, m; positions alone are seen
    #[arg(long, default_value_t = 0.005)]
    noise: f64,
    /// An effect that every world has and the simulation lacks, `name:parameter=value`
    #[arg(long)]
    leave: Option<String>,
    /// Recordings of throws, whose misfit and spreads are drawn along, in place of a family's tasks
    #[arg(long, conflicts_with_all = ["leave", "task", "follow"])]
    recorded: bool,
    /// Take the model for complete
    #[arg(long)]
    no_discrepancy: bool,
    /// Follow what the model lacks
    #[arg(long, conflicts_with = "no_discrepancy")]
    follow: bool,
    /// Particles of each of four runs
    #[arg(long, default_value_t = 256)]
    particles: usize,
    /// Where the table goes
    #[arg(long, default_value = "calibration.md")]
    out: PathBuf,
}

/// A world as it was drawn, and what was measured in it.
struct Drawn {
    scene: Scene,
    trials: Vec<Trial>,
    /// Effects that are asked for.
    set: Vec<String>,
    /// What the numbers of its posterior are.
    truth: Vec<f64>,
}

/// Ranks are counted in so many bins.
const BINS: usize = 10;
/// Draws of a world among which the truth ranks, thinned from all: 99, so that there are 100 ranks.
const KEPT: usize = 99;

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let run = Run::parse();
    let log = run.out.with_extension("csv");
    let text = std::fs::read_to_string(&log).unwrap_or_default();
    let done: HashSet<&str> = text.lines().filter_map(|l| l.split(',').next()).collect();
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(&log)?;
    for seed in run.first..run.first + run.worlds {
        let lacks = match (run.no_discrepancy, run.follow) {
            (true, _) => "complete",
            (_, true) => "followed",
            _ => "field",
        };
        let left = if run.recorded { "recordings" } else { "nothing" };
        // Commas part what is said of a world.
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

/// Of each number its rank among the thinned draws and how sure they are, then whether draws converged, and seconds.
fn world(run: &Run, seed: u64) -> Result<String> {
    let begun = Instant::now();
    let usual = PosteriorConfig::standard(seed);
    let drawn =
        if run.recorded { recordings::drawn(run, seed) } else { tasks::drawn(run, &usual.prior, seed) };
    let Drawn { scene, trials, set, truth } = drawn?;
    let sampler = Sampler::Smc(SmcConfig { particles: run.particles, ..SmcConfig::standard(seed) });
    let (discrepancy, follow) = (!run.no_discrepancy, run.follow);
    let config = PosteriorConfig { sampler, sets: vec![set], discrepancy, follow, ..usual };
    let found = posterior(&scene, &trials, &config, &Silent)?;
    let draws = &found.sets[0].draws;
    let of = |(k, truth): (usize, &f64)| {
        let all: Vec<f64> = draws.points.iter().map(|p| p[k]).collect();
        let thinned = (0..KEPT).map(|i| all[i * all.len() / KEPT]);
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

/// By number: how often 90 % intervals hold the truth, and whether ranks are uniform.
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
        let names: &[&str] = if kind.starts_with("recordings") { &recordings::ASKED } else { &tasks::ASKED };
        // Behind what is said of each number: whether draws converged, what is lacking, seconds.
        let rest = 1 + 4 * names.len();
        for (k, name) in names.iter().enumerate() {
            let first = 1 + 4 * k;
            let mut counts = [0.0; BINS];
            own.iter()
                .for_each(|r| counts[((number(r, first) as usize) * BINS / (KEPT + 1)).min(BINS - 1)] += 1.0);
            let wanted = own.len() as f64 / BINS as f64;
            let chi: f64 = counts.iter().map(|c| (c - wanted).powi(2) / wanted).sum();
            let mut widths: Vec<f64> = own.iter().map(|r| number(r, first + 3)).collect();
            widths.sort_by(f64::total_cmp);
            out += &format!(
                "| {kind} | {name} | {} | {:.1} % | {chi:.1} ({}) | {:.4} | {:.2e} | {:.0} % | {:.1} |\n",
                own.len(),
                100.0 * mean(first + 1),
                counts.map(|c| format!("{c}")).join(" "),
                above(chi, (BINS - 1) as f64),
                widths[widths.len() / 2],
                100.0 * mean(rest),
                mean(rest + 2)
            );
        }
    }
    out
}

/// P(chi squared > `x`): Fisher's F with as good as infinitely many degrees below.
fn above(x: f64, degrees: f64) -> f64 {
    iplw::distribution::f_above(x / degrees, degrees, 1e7)
}
