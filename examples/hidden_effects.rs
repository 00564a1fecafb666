//! Hides effects in worlds of its own making, has them diagnosed, and counts how often the diagnosis is right.
//!
//! `cargo run --release --example hidden_effects -- --worlds 5`: that many worlds of every kind.
//! `... -- --worlds 0 --nothing 50`: that many worlds with nothing hidden for each kind of noise.

#[path = "../tests/discover_worlds/mod.rs"]
mod worlds;

use std::collections::BTreeMap;

use iplw::discover::report::{Diagnosis, Verdict};
use iplw::discover::{Config, diagnose};
use iplw::progress::Silent;
use worlds::{Hidden, NOISES, Noise};

#[derive(Default)]
struct Count {
    right: usize,
    all: usize,
}

impl Count {
    fn add(&mut self, right: bool) {
        self.right += usize::from(right);
        self.all += 1;
    }

    fn show(&self) -> String {
        format!(
            "{:5.1} % ({} of {})",
            100.0 * self.right as f64 / self.all.max(1) as f64,
            self.right,
            self.all
        )
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |name: &str, usual: usize| {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|i| arguments.get(i + 1)?.parse().ok()).unwrap_or(usual)
    };
    let (worlds, first) = (number("--worlds", 2), number("--seed", 0) as u64);
    let mut table: BTreeMap<(String, String), usize> = BTreeMap::new();
    let mut counts: BTreeMap<String, Count> = BTreeMap::new();
    let mut count = |name: String, right: bool| counts.entry(name).or_default().add(right);
    let (mut errors, mut removed) = (Vec::new(), Vec::new());
    for w in 0..number("--nothing", 0) as u64 {
        for (k, noise) in NOISES.iter().enumerate() {
            let d = look(&worlds::nothing(), *noise, iplw::rng::derive(first, "nothing", 4 * w + k as u64));
            count(format!("false alarms, {noise:?} noise"), d.verdict != Verdict::None);
            note(&mut table, "nothing", &d);
        }
    }
    for w in 0..worlds as u64 {
        let seed = |kind: u64| iplw::rng::derive(first, "world", 100 * w + kind);
        for (k, noise) in NOISES.iter().enumerate() {
            let d = look(&worlds::nothing(), *noise, seed(k as u64));
            count(format!("false alarms, {noise:?} noise"), d.verdict != Verdict::None);
            note(&mut table, "nothing", &d);
        }
        for kind in 0..worlds::SINGLES {
            let noise = NOISES[(kind + w as usize) % 4];
            let hidden = worlds::single(kind, seed(10 + kind as u64));
            let d = look(&hidden, noise, seed(10 + kind as u64));
            let truth = hidden.names.clone();
            let within = d.rivals.iter().any(|r| same(r, &truth));
            count("detected".into(), d.verdict != Verdict::None && d.verdict != Verdict::InsufficientData);
            count("named right".into(), d.verdict == Verdict::Named && within);
            count(format!("named right, {}", truth[0]), d.verdict == Verdict::Named && within);
            count("truth in the reported set".into(), within);
            count("confidently wrong".into(), d.verdict == Verdict::Named && !within);
            note(&mut table, truth[0], &d);
            if let (true, Some((effect, name, value))) =
                (within && d.verdict == Verdict::Named, hidden.parameter)
            {
                let found = d.effects.iter().find(|e| e.name == effect);
                if let Some(p) = found.and_then(|e| e.parameters.iter().find(|p| p.name == name)) {
                    errors.push((p.value / value - 1.0).abs());
                    if let [Some(a), Some(b)] = p.ci95 {
                        count("95 % intervals that hold the truth".into(), a <= value && value <= b);
                        count(
                            format!("95 % intervals that hold the truth, {effect}"),
                            a <= value && value <= b,
                        );
                    }
                }
            }
            removed.extend(d.gain.held_out.as_ref().and_then(|g| g.excess_removed));
        }
        for kind in 0..5 {
            let hidden = worlds::double(kind, seed(40 + kind as u64));
            let d = look(&hidden, NOISES[(kind + w as usize) % 4], seed(40 + kind as u64));
            let within = d.rivals.iter().any(|r| same(r, &hidden.names));
            count("two effects both in the reported set".into(), within);
            count("two effects: confidently wrong".into(), d.verdict == Verdict::Named && !within);
            note(&mut table, &hidden.names.join(" + "), &d);
        }
        for kind in 0..4 {
            let hidden = worlds::outside(kind, seed(60 + kind as u64));
            let d = look(&hidden, NOISES[(kind + w as usize) % 4], seed(60 + kind as u64));
            count("outside the library: unknown".into(), d.verdict == Verdict::Unknown);
            count("outside the library: confidently named".into(), d.verdict == Verdict::Named);
            note(&mut table, &format!("outside {kind}"), &d);
        }
    }
    println!("{:<34} {:<60} worlds", "hidden", "diagnosed");
    for ((hidden, found), number) in &table {
        println!("{hidden:<34} {found:<60} {number}");
    }
    println!();
    for (name, count) in &counts {
        println!("{name:<44} {}", count.show());
    }
    errors.sort_by(f64::total_cmp);
    removed.sort_by(f64::total_cmp);
    let middle = |v: &[f64]| v.get(v.len() / 2).copied().unwrap_or(f64::NAN);
    println!("{:<44} {:.2} %", "median relative error of the parameter", 100.0 * middle(&errors));
    println!("{:<44} {:.2} %", "median share of held-out excess removed", 100.0 * middle(&removed));
}

/// Fourteen trials of forty observations; paths shifted by five noise deviations.
fn look(hidden: &Hidden, noise: Noise, seed: u64) -> Diagnosis {
    let trials = worlds::trials(hidden, noise, 14, 40, 5.0, seed);
    match diagnose(&worlds::scene(), &trials, &Config::standard(seed), &Silent) {
        Ok(found) => found.diagnosis,
        Err(e) => panic!("a generated world could not be diagnosed: {e}"),
    }
}

fn same(rival: &[String], truth: &[&str]) -> bool {
    let mut truth = truth.to_vec();
    truth.sort_unstable();
    rival.iter().map(String::as_str).eq(truth)
}

fn note(table: &mut BTreeMap<(String, String), usize>, hidden: &str, d: &Diagnosis) {
    let sets: Vec<String> = d.rivals.iter().map(|r| r.join(" + ")).collect();
    let found = format!("{:?} {}", d.verdict, sets.join(" | "));
    *table.entry((hidden.to_string(), found)).or_default() += 1;
}
