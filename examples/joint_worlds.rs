//! Hides one effect in the joints of generated mechanisms and diagnoses their recordings: a table of what was hidden and named.
//!
//!     cargo run --release --example joint_worlds -- [worlds] [first seed] [mechanism] [directory]
//!
//! With a directory it writes each world there, and diagnoses nothing: `SEED.json` with the scene and the hidden effect, `SEED.csv`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use iplw::error::{Error, Result};
use iplw::inference::mechanism::{JointDiagnosis, diagnose_joints, effect_in_joint};
use iplw::progress::NoProgress;
use iplw::reality::joint_worlds::{JointWorld, Mechanism, RecordingPlan};
use iplw::rng::derive_seed;
use iplw::world::mechanism::Tree;

/// Worlds without a hidden effect: one in so many.
const NOTHING_HIDDEN_EVERY: u64 = 5;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let worlds: u64 = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(6);
    let first: u64 = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(1);
    let only = arguments.next().and_then(|name| Mechanism::named(&name));
    let directory = arguments.next().map(PathBuf::from);
    let plan = RecordingPlan { trials: 20, duration: 5.0, rate: 100.0, noise: 1e-3 };
    let mut counts = Counts::default();
    for seed in first..first + worlds {
        let mechanism = only.unwrap_or(Mechanism::ALL[seed as usize % Mechanism::ALL.len()]);
        let choices = mechanism.effects()?;
        let draw = derive_seed(seed, "hidden effect", 0) as usize;
        let hidden = (!(seed / Mechanism::ALL.len() as u64).is_multiple_of(NOTHING_HIDDEN_EVERY))
            .then(|| choices[draw % choices.len()]);
        let world = mechanism.world(hidden, &plan, seed)?;
        if let Some(directory) = &directory {
            write(&world, directory, seed)?;
            continue;
        }
        let start = Instant::now();
        let found = diagnose_joints(&world.scene, &world.trials, 3, 0, &NoProgress)?;
        let names = &Tree::of(&world.scene)?.names;
        let truth = world.truth.as_ref().map(|t| effect_in_joint(t.effect.name, &names[t.joint]));
        let outcome = counts.add(truth.as_deref(), &found);
        counts.add_intervals(&world, &found);
        let values = world.truth.as_ref().map_or(String::new(), |t| format!("{:.4?}", t.values));
        let estimates: Vec<String> = found
            .effects
            .iter()
            .flat_map(|e| e.parameters.iter().map(|p| format!("{:.4}+-{:.4}", p.value, p.sd)))
            .collect();
        println!(
            "{:>4} {:9} {:14} hidden {} {values}: {} {:?} p(none) {:.2} share {:.2?} gain {:.2?} [{}] {:.1} s",
            seed,
            mechanism.name(),
            outcome,
            truth.as_deref().unwrap_or("nothing"),
            found.verdict.name(),
            found.rivals,
            found.none_probability,
            found.explained_interval,
            found.held_out_gain,
            estimates.join(" "),
            start.elapsed().as_secs_f64(),
        );
    }
    println!("{counts:?}");
    Ok(())
}

/// Writes a world.
fn write(world: &JointWorld, directory: &Path, seed: u64) -> Result<()> {
    let names = &Tree::of(&world.scene)?.names;
    let truth = world.truth.as_ref().map(|t| {
        let values: BTreeMap<&str, f64> =
            t.effect.parameters.iter().map(|p| p.name).zip(t.values.iter().copied()).collect();
        serde_json::json!({"name": t.effect.name, "acts_on": names[t.joint], "parameters": values})
    });
    let driven: Vec<usize> = (0..names.len()).filter(|j| world.trials[0].commands.drives(*j)).collect();
    let mut csv = format!("trial,t,{}", names.join(","));
    driven.iter().for_each(|j| csv += &format!(",{}.command", names[*j]));
    csv.push('\n');
    for trial in &world.trials {
        for (t, q) in trial.times.iter().zip(&trial.positions) {
            let commands = driven.iter().map(|j| trial.commands.mean(*j, [*t, *t]));
            let numbers: Vec<String> = q.iter().copied().chain(commands).map(|v| v.to_string()).collect();
            csv += &format!("{},{t},{}\n", trial.id, numbers.join(","));
        }
    }
    let document = serde_json::json!({"scene": world.scene, "truth": truth});
    for (ending, text) in [("json", document.to_string()), ("csv", csv)] {
        let path = directory.join(format!("{seed}.{ending}"));
        std::fs::write(&path, text).map_err(|e| Error::io(&path, e))?;
    }
    Ok(())
}

/// Numbers of outcomes.
#[derive(Debug, Default)]
struct Counts {
    hidden: usize,
    right_alone: usize,
    in_the_set: usize,
    unknown: usize,
    missed: usize,
    wrong: usize,
    nothing: usize,
    false_names: usize,
    intervals: usize,
    intervals_with_truth: usize,
}

impl Counts {
    /// Counts the 90 % intervals of a right name that hold the truth.
    fn add_intervals(&mut self, world: &JointWorld, found: &JointDiagnosis) {
        let (Some(truth), [effect]) = (&world.truth, found.effects.as_slice()) else { return };
        if effect.name != truth.effect.name {
            return;
        }
        for (p, value) in effect.parameters.iter().zip(&truth.values) {
            self.intervals += 1;
            self.intervals_with_truth += usize::from((p.value - value).abs() <= 1.645 * p.sd);
        }
    }

    fn add(&mut self, truth: Option<&str>, found: &JointDiagnosis) -> &'static str {
        let sets = &found.rivals;
        let Some(truth) = truth else {
            self.nothing += 1;
            let named = !sets.is_empty() && found.verdict.name() != "unknown";
            self.false_names += usize::from(named);
            return if named { "FALSE NAME" } else { "nothing" };
        };
        self.hidden += 1;
        let right = |set: &Vec<String>| set.len() == 1 && set[0] == truth;
        match found.verdict.name() {
            "named" if right(&sets[0]) => {
                self.right_alone += 1;
                "right"
            }
            "named" | "ambiguous" if sets.iter().any(right) => {
                self.in_the_set += 1;
                "in the set"
            }
            "named" | "ambiguous" => {
                self.wrong += 1;
                "WRONG"
            }
            "unknown" => {
                self.unknown += 1;
                "unknown"
            }
            _ => {
                self.missed += 1;
                "missed"
            }
        }
    }
}
