//! Studies of many worlds: results are appended to a log immediately, interrupted studies resume, and figures
//! have confidence intervals.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use clap::{CommandFactory as _, FromArgMatches as _};
use iplw::inference::report::Diagnosis;
use iplw::reality::{Trial, trials_to_csv};
use iplw::task::Scene;

/// Studies worlds, appends each outcome to a log next to the table, and resumes an interrupted study
#[derive(Clone, Debug, clap::Parser)]
pub struct Run {
    /// Number of worlds
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    pub worlds: u64,
    /// Random seed of the worlds
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Number of worlds studied in parallel, each on one thread
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    pub threads: u64,
    /// Output file of the table
    #[arg(long)]
    pub out: PathBuf,
    /// Only kinds whose name contains this
    #[arg(long, default_value = "")]
    pub only: String,
    /// Errors that all trials share, besides those that differ by trial
    #[arg(long)]
    pub shared: bool,
    /// Diagnose the trials of each world only: no clean twins, no recommended trials
    #[arg(long)]
    pub once: bool,
    /// Write the trials, the scene and the hidden truth of each world to DIR/ID
    #[arg(long, value_name = "DIR")]
    pub export: Option<PathBuf>,
    /// Fail if a larger share of the worlds gets a wrong name
    #[arg(long, value_name = "SHARE")]
    pub most_wrong: Option<f64>,
    /// Print the candidate models of each diagnosis
    #[arg(long = "show")]
    pub talk: bool,
}

impl Run {
    /// Parses the command line with defaults for the number of worlds and the output file.
    pub fn with(worlds: &'static str, out: &'static str) -> Run {
        let command = Run::command()
            .mut_arg("worlds", |a| a.default_value(worlds))
            .mut_arg("out", |a| a.default_value(out));
        Run::from_arg_matches(&command.get_matches()).unwrap_or_else(|e| e.exit())
    }

    /// Studies the worlds of `count` that are not in the log yet, and returns the log. `study`: from a world's
    /// number and id to its lines, which begin with the id, or `None` to skip it.
    pub fn log(
        &self,
        log: &str,
        count: u64,
        study: impl Fn(u64, &str) -> Option<String> + Sync,
    ) -> std::io::Result<String> {
        if let Some(folder) = self.out.parent() {
            let named = |e| std::io::Error::other(format!("--out: {}: {e}", folder.display()));
            std::fs::create_dir_all(folder).map_err(named)?;
        }
        let log = self.out.with_file_name(log);
        let known = std::fs::read_to_string(&log).unwrap_or_default();
        let done: HashSet<&str> = known.lines().filter_map(|l| Some(l.split_once(',')?.0)).collect();
        let file = Mutex::new(std::fs::OpenOptions::new().create(true).append(true).open(&log)?);
        let begun = std::time::Instant::now();
        let next = AtomicU64::new(0);
        let worker = || -> std::io::Result<()> {
            // One thread per world, so that run times are those of one processor.
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(std::io::Error::other)?;
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                if i >= count {
                    return Ok(());
                }
                let id = format!("{}/{i}", self.seed);
                if done.contains(id.as_str()) {
                    continue;
                }
                let Some(lines) = pool.install(|| study(i, &id)) else { continue };
                let mut file =
                    file.lock().map_err(|_| std::io::Error::other("a world could not be written"))?;
                file.write_all(lines.as_bytes())?;
                if i % 20 == 19 {
                    eprintln!("{} of {count} worlds, {:.0} s", i + 1, begun.elapsed().as_secs_f64());
                }
            }
        };
        std::thread::scope(|scope| {
            let all: Vec<_> = (0..self.threads).map(|_| scope.spawn(worker)).collect();
            all.into_iter().try_for_each(|t| t.join().expect("a world could not be diagnosed"))
        })?;
        // The log may also contain worlds of other seeds.
        let own = format!("{}/", self.seed);
        let all = std::fs::read_to_string(&log)?;
        Ok(all.lines().filter(|l| l.starts_with(&own)).flat_map(|l| [l, "\n"]).collect())
    }

    /// Writes a world for other programs, if asked for: `trials.csv`, `scene.json` and `truth.json`. `right`: the correct
    /// sets of effects, none if nothing, or nothing from the library, is hidden.
    pub fn export(
        &self,
        id: &str,
        kind: &str,
        right: &[Vec<&str>],
        scene: &Scene,
        trials: &[Trial],
    ) -> std::io::Result<()> {
        let Some(folder) = self.export.as_ref().map(|root| root.join(id)) else { return Ok(()) };
        let named = |e| std::io::Error::other(format!("--export: {}: {e}", folder.display()));
        let truth = serde_json::json!({
            "kind": kind,
            "right": right,
            "free_flight": scene.statics.is_empty(),
        });
        std::fs::create_dir_all(&folder).map_err(named)?;
        for (name, text) in [
            ("trials.csv", trials_to_csv(trials)),
            ("scene.json", serde_json::to_string(scene)?),
            ("truth.json", truth.to_string()),
        ] {
            std::fs::write(folder.join(name), text).map_err(named)?;
        }
        Ok(())
    }

    /// Writes and prints the table; fails if more than [`Run::most_wrong`] of all worlds got a wrong name.
    pub fn tell(&self, table: &str, [wrong, all]: [usize; 2]) -> std::io::Result<()> {
        print!("{table}");
        std::fs::write(&self.out, table)?;
        match self.most_wrong {
            Some(most) if wrong as f64 > most * all as f64 => {
                let text = format!(
                    "{wrong} of {all} worlds got a wrong name; --most-wrong allows a share of {most}"
                );
                Err(std::io::Error::other(text))
            }
            _ => Ok(()),
        }
    }
}

/// Prints the reason, the best models and the estimates of a diagnosis.
pub fn weighed(d: &Diagnosis) {
    eprintln!("  {}", d.reason);
    for s in d.scores.iter().take(10) {
        let sets = s.effects.join("+");
        eprintln!("  {:9.2} nats, probability {:.3}: {sets}", s.score, s.probability);
    }
    for (e, p) in d.effects.iter().flat_map(|e| e.parameters.iter().map(move |p| (e, p))) {
        eprintln!("  {}.{} = {:.4} {:?} spread {:?}", e.name, p.name, p.value, p.ci95, p.spread);
    }
    for c in &d.calibrated {
        eprintln!("  {} = {:.4} {:?}, identifiable: {}", c.name, c.value, c.ci95, c.identifiable);
    }
}

/// Reported sets: names joined by `+`, sets by `|`.
pub fn sets(d: &Diagnosis) -> String {
    d.rivals.iter().map(|r| r.join("+")).collect::<Vec<_>>().join("|")
}

/// A table of rates, `right` of `all` each, with 95 % intervals; rows without worlds are omitted.
pub fn rates<'a>(counts: impl IntoIterator<Item = (&'a str, [usize; 2])>) -> String {
    let mut out = String::from("| figure | seen | 95 % | worlds |\n|---|---|---|---|\n");
    for (name, [right, all]) in counts.into_iter().filter(|(_, [_, all])| *all > 0) {
        let share = 100.0 * right as f64 / all as f64;
        let [low, high] = wilson(right, all).map(|v| 100.0 * v);
        let _ = writeln!(out, "| {name} | {share:.1} % | {low:.1} to {high:.1} | {right} of {all} |");
    }
    out
}

/// The 95 % interval of a share by Wilson's score (J. Am. Stat. Assoc. 22 (1927) 209).
pub fn wilson(right: usize, all: usize) -> [f64; 2] {
    if all == 0 {
        return [0.0, 1.0];
    }
    const Z: f64 = 1.959964;
    let (n, share) = (all as f64, right as f64 / all as f64);
    let middle = share + Z * Z / (2.0 * n);
    let reach = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
    [-1.0, 1.0].map(|side| ((middle + side * reach) / (1.0 + Z * Z / n)).clamp(0.0, 1.0))
}

/// Median; NaN for no values.
pub fn middle(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
