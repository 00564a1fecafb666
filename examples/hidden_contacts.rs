//! Benchmark of the diagnosis on motions with contacts, simulated by the program's own engine: false names where nothing is hidden,
//! and how often a wrong friction, mass ratio, restitution, threshold or moment of inertia is found.
//!
//! `cargo run --release --example hidden_contacts -- --seeds 10 --out FILE.md`; `--only NAME` selects kinds of motion, `--wrong NAME` what is
//! wrong (`Nothing` for false names).

#[path = "../tests/discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use clap::Parser as _;
use iplw::inference::report::{Diagnosis, Verdict};
use iplw::inference::{DiagnosisConfig, diagnose};
use iplw::progress::NoProgress;
use worlds::contact_motion::{ContactWorld, KINDS, WRONGS, contact_world, shows};
use worlds::study::{sets, weighed};

/// Motions with contacts: what does the diagnosis find?
#[derive(clap::Parser)]
struct Args {
    /// Recordings of each kind
    #[arg(long, default_value_t = 10)]
    seeds: u64,
    /// First seed
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Only kinds of motion whose name contains this
    #[arg(long, default_value = "")]
    only: String,
    /// Only this error of the scene
    #[arg(long, default_value = "")]
    wrong: String,
    /// Print the weights of the sets
    #[arg(long)]
    show: bool,
    /// Table to write
    #[arg(long, default_value = "out/hidden_contacts.md")]
    out: std::path::PathBuf,
}

/// Counts of a kind of error: recordings, found, intervals, intervals that hold the truth, wrongly named.
#[derive(Default)]
struct Counts {
    all: usize,
    found: usize,
    intervals: usize,
    covered: usize,
    misnamed: usize,
}

fn main() -> std::io::Result<()> {
    let args = Args::parse();
    let mut counts: BTreeMap<String, Counts> = BTreeMap::new();
    for wrong in WRONGS.into_iter().filter(|w| format!("{w:?}").contains(&args.wrong)) {
        for kind in KINDS.into_iter().filter(|k| k.contains(&args.only) && shows(k, wrong)) {
            for seed in args.seed..args.seed + args.seeds {
                let world = contact_world(kind, wrong, seed);
                let found =
                    diagnose(&world.scene, &world.trials, &DiagnosisConfig::standard(seed), &NoProgress);
                let found = found.expect("a diagnosis").diagnosis;
                let counts = counts.entry(format!("{wrong:?}")).or_default();
                counts.add(&world, &found);
                if args.show {
                    weighed(&found);
                    eprintln!("{}", found.reason);
                }
                let latents: Vec<String> = found
                    .calibrated
                    .iter()
                    .filter(|c| c.identifiable)
                    .map(|c| {
                        format!(
                            "{} {:.3} [{:.4}, {:.4}]",
                            c.name,
                            c.value,
                            c.ci95[0].unwrap_or(f64::NAN),
                            c.ci95[1].unwrap_or(f64::NAN)
                        )
                    })
                    .collect();
                println!(
                    "{kind} {wrong:?} {seed}: {:?} {} {} {:?}",
                    found.verdict,
                    sets(&found),
                    latents.join(", "),
                    world.wrong
                );
            }
        }
    }
    let mut table = String::from(
        "| wrong in the scene | recordings | found | interval holds the truth | wrong name |\n|---|---|---|---|---|\n",
    );
    for (wrong, c) in &counts {
        let _ = writeln!(
            table,
            "| {wrong} | {} | {} | {} of {} | {} |",
            c.all, c.found, c.covered, c.intervals, c.misnamed
        );
    }
    println!("{table}");
    if let Some(folder) = args.out.parent() {
        std::fs::create_dir_all(folder)?;
    }
    std::fs::write(&args.out, table)
}

impl Counts {
    fn add(&mut self, world: &ContactWorld, found: &Diagnosis) {
        self.all += 1;
        let Some((name, truth)) = world.wrong else {
            let none = found.verdict == Verdict::None;
            self.found += usize::from(none);
            self.misnamed += usize::from(found.verdict == Verdict::Named);
            return;
        };
        let effect = name.split_once('.');
        let interval = match effect {
            None => found.calibrated.iter().find(|c| c.name == name && c.identifiable).map(|c| c.ci95),
            Some((effect, parameter)) => found
                .effects
                .iter()
                .find(|e| e.name == effect)
                .and_then(|e| e.parameters.iter().find(|p| p.name == parameter))
                .map(|p| p.ci95),
        };
        let interval = interval.and_then(|[low, high]| Some([low?, high?]));
        let in_set =
            effect.is_some_and(|(effect, _)| found.rivals.iter().any(|set| set.iter().any(|e| e == effect)));
        self.found += usize::from(interval.is_some() || in_set);
        if let Some([low, high]) = interval {
            self.intervals += 1;
            self.covered += usize::from((low..=high).contains(&truth));
        }
        let right = effect.is_some_and(|(effect, _)| found.effects.iter().all(|e| e.name == effect));
        self.misnamed += usize::from(found.verdict == Verdict::Named && !right);
    }
}
