//! Benchmark of the diagnosis on realistic synthetic recordings with hidden effects: counts how often the diagnosis is correct.
//!
//! `cargo run --release --example hidden_recordings -- --worlds 400 --out rates.md`: 400 worlds, cycling through the kinds
//! (`--only KIND`: only kinds whose name contains KIND). `--seed` selects other worlds, `--threads` runs several in parallel,
//! each on one thread; `--shared` adds errors that all trials share. Each result is appended to `recordings.csv` next to the table, and an interrupted run resumes.
//! `--export DIR` writes the worlds for other methods (`benches/other_diagnoses.py`).
//!
//! The limit of identifiability is the result of the same method on the same trials without noise and outliers (the clean
//! twin). Sets that such data cannot distinguish count as one: gravity, scale and clock in free flight; a tilted camera and
//! wind along x; and, if spin varies, quadratic drag with and without lift.

#[path = "../tests/discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::time::Instant;

use clap::CommandFactory as _;
use iplw::inference::report::{Diagnosis, ParameterEstimate, Verdict};
use iplw::inference::{DiagnosisConfig, diagnose};
use iplw::progress::NoProgress;
use iplw::reality::Trial;
use worlds::recorded::{Kind, Size, World, kinds, world};
use worlds::study::{Run, middle, rates, sets, weighed};

/// Maximum number of rival sets for a report to count as correct.
const MAX_RIVALS: usize = 4;
/// Relative tolerance of the drag of a ball with varying spin.
const DRAG_TOLERANCE: f64 = 0.1;

fn main() -> std::io::Result<()> {
    let run = Run::with("400", "out/hidden_recordings.md");
    let kinds = kinds();
    if !kinds.iter().any(|k| k.name().contains(&run.only)) {
        let all: BTreeSet<_> = kinds.iter().map(|k| k.name()).collect();
        let allowed = all.into_iter().collect::<Vec<_>>().join(", ");
        let text = format!("--only: no kind has `{}` in its name; allowed: part of {allowed}\n", run.only);
        Run::command().error(clap::error::ErrorKind::InvalidValue, text).exit();
    }
    let log = run.log("recordings.csv", run.worlds, |i, id| {
        let kind = kinds[i as usize % kinds.len()].name();
        kind.contains(&run.only)
            .then(|| format!("{id},{}\n", study(&world(i, run.seed, run.shared), id, i, &run)))
    })?;
    let lines: Vec<ResultRow> = log.lines().filter_map(ResultRow::read).collect();
    let wrong = lines.iter().filter(|l| l.verdict == "Named" && !l.within(&l.sets)).count();
    run.tell(&table(&lines), [wrong, lines.len()])
}

/// Result row of a world without its id; see [`ResultRow`].
fn study(world: &World, id: &str, seed: u64, run: &Run) -> String {
    run.export(id, &world.kind.name(), &world.right, &world.scene, &world.trials)
        .expect("the world can be written");
    let look = |trials: &[Trial]| {
        let from = Instant::now();
        match diagnose(&world.scene, trials, &DiagnosisConfig::standard(seed), &NoProgress) {
            Ok(found) => (found.diagnosis, from.elapsed().as_secs_f64()),
            Err(e) => panic!("world {id} could not be diagnosed: {e}"),
        }
    };
    let (d, seconds) = look(&world.trials);
    let twin = !run.once && matches!(world.kind, Kind::Single(_) | Kind::Pair(_) | Kind::Contact(_));
    let clean = twin.then(|| look(&world.clean));
    let clean =
        clean.map_or(",,".into(), |(d, seconds)| format!("{:?},{},{seconds:.2}", d.verdict, sets(&d)));
    let right: Vec<String> = world.right.iter().map(|s| s.join("+")).collect();
    let (errors, covered, spread) = compared(world, &d);
    let launches = if world.alike { "alike" } else { "unlike" };
    let line = format!(
        "{},{},{launches},{},{:.2},{:.1},{:.1},{:?},{},{errors},{covered},{spread},{seconds:.2},{clean}",
        world.kind.name(),
        right.join("|"),
        world.trials.len(),
        1e3 * world.noise,
        world.shift,
        world.margin,
        d.verdict,
        sets(&d),
    );
    if run.talk {
        eprintln!("{id},{line}");
        weighed(&d);
    }
    line
}

/// Relative errors of the hidden parameters, if the reported set is correct (or spin varies); whether intervals contain them
/// (each joined by `+`); and a between-trial spread: of lift if spin varies, otherwise of the first parameter relative to its
/// size.
fn compared(world: &World, d: &Diagnosis) -> (String, String, String) {
    let found = |effect: &str, parameter: &str| -> Option<&ParameterEstimate> {
        let effect = d.effects.iter().find(|e| e.name == effect)?;
        effect.parameters.iter().find(|p| p.name == parameter)
    };
    let is_right = |rival: &Vec<String>| world.right.iter().any(|set| set.iter().eq(rival.iter()));
    let comparable = matches!(d.verdict, Verdict::Named | Verdict::Ambiguous)
        && (world.kind == Kind::Spin || d.rivals.iter().all(is_right));
    if !comparable {
        return Default::default();
    }
    let told: Vec<_> = world.sizes.iter().filter_map(|s| Some((s, found(s.effect, s.parameter)?))).collect();
    // With a fast clock the same drag is smaller: together with a twin, a parameter has another value.
    if told.len() < world.sizes.len() {
        return Default::default();
    }
    let error = |(s, p): &(&Size, &ParameterEstimate)| {
        format!("{:.4}", ((p.value - s.value) / (s.value - s.neutral)).abs())
    };
    let covers = |(s, p): &(&Size, &ParameterEstimate)| match p.ci95 {
        [Some(a), Some(b)] => Some(u8::from((a..=b).contains(&s.value)).to_string()),
        _ => None,
    };
    let spread = match world.kind {
        // Reported in the set or as between-trial variation.
        Kind::Spin => found("lift", "s")
            .and_then(spread)
            .or_else(|| d.unlike.iter().find(|u| u.effect == "lift").map(|u| u.spread)),
        _ => told.first().and_then(|(s, p)| Some(spread(p)? / (s.value - s.neutral).abs())),
    };
    (
        told.iter().map(error).collect::<Vec<_>>().join("+"),
        told.iter().filter_map(covers).collect::<Vec<_>>().join("+"),
        spread.map_or(String::new(), |s| format!("{s:.4}")),
    )
}

/// Between-trial standard deviation of a parameter, if reported.
fn spread(parameter: &ParameterEstimate) -> Option<f64> {
    serde_json::to_value(parameter).ok()?.get("spread")?.as_f64()
}

/// A world's row in the log. Sets are names joined by `+`, several sets are joined by `|`.
struct ResultRow {
    kind: String,
    /// Correct sets.
    right: Vec<String>,
    launches: String,
    verdict: String,
    sets: Vec<String>,
    errors: Vec<f64>,
    covered: Vec<bool>,
    spread: Option<f64>,
    seconds: f64,
    clean_verdict: String,
    clean_sets: Vec<String>,
}

impl ResultRow {
    fn read(row: &str) -> Option<ResultRow> {
        let cells: Vec<&str> = row.split(',').collect();
        let [
            _,
            kind,
            right,
            launches,
            _count,
            _noise,
            _shift,
            _margin,
            verdict,
            sets,
            errors,
            covered,
            spread,
            seconds,
            clean_verdict,
            clean_sets,
            _clean_seconds,
        ] = cells[..]
        else {
            return None;
        };
        let apart = |sets: &str| sets.split('|').filter(|s| !s.is_empty()).map(String::from).collect();
        Some(ResultRow {
            kind: kind.into(),
            right: apart(right),
            launches: launches.into(),
            verdict: verdict.into(),
            sets: apart(sets),
            errors: errors.split('+').filter_map(|e| e.parse().ok()).collect(),
            covered: covered.split('+').filter(|c| !c.is_empty()).map(|c| c == "1").collect(),
            spread: spread.parse().ok(),
            seconds: seconds.parse().ok()?,
            clean_verdict: clean_verdict.into(),
            clean_sets: apart(clean_sets),
        })
    }

    /// Whether a correct set is among `sets`.
    fn within(&self, sets: &[String]) -> bool {
        sets.iter().any(|s| self.right.contains(s))
    }

    /// Number of reported sets, with all correct ones counted as one.
    fn rivals(&self, sets: &[String]) -> usize {
        sets.iter().filter(|s| !self.right.contains(s)).count() + usize::from(self.within(sets))
    }

    fn one_and_right(&self, verdict: &str, sets: &[String]) -> bool {
        matches!(verdict, "Named" | "Ambiguous") && self.within(sets) && self.rivals(sets) == 1
    }

    fn right_alone(&self) -> bool {
        self.one_and_right(&self.verdict, &self.sets)
    }

    /// Whether the same method names the effect for noise-free data.
    fn allowed(&self) -> bool {
        self.one_and_right(&self.clean_verdict, &self.clean_sets)
    }

    fn reported(&self) -> bool {
        matches!(self.verdict.as_str(), "Named" | "Ambiguous")
    }

    fn in_set(&self) -> bool {
        self.reported() && self.within(&self.sets) && self.rivals(&self.sets) <= MAX_RIVALS
    }

    /// Whether every reported set contains an effect.
    fn holds(&self, effect: &str) -> bool {
        self.reported() && self.sets.iter().all(|s| s.split('+').any(|n| n == effect))
    }

    fn near(&self) -> bool {
        self.errors.first().is_some_and(|e| *e <= DRAG_TOLERANCE)
    }
}

/// Number of selected worlds for which a predicate holds.
fn count(
    lines: &[ResultRow],
    name: impl Into<String>,
    some: impl Fn(&ResultRow) -> bool,
    holds: impl Fn(&ResultRow) -> bool,
) -> (String, [usize; 2]) {
    let some: Vec<&ResultRow> = lines.iter().filter(|l| some(l)).collect();
    (name.into(), [some.iter().filter(|l| holds(l)).count(), some.len()])
}

fn table(lines: &[ResultRow]) -> String {
    let mut out = shares(&figures(lines));
    out += "\n";
    out += &shares(&by_truth(lines));
    out += "\n| figure | median | most | of |\n|---|---|---|---|\n";
    let mut row = |name: &str, unit: &str, digits: usize, mut values: Vec<f64>| {
        let number = values.len();
        if number == 0 {
            return;
        }
        let median = middle(&mut values);
        let most = values.last().copied().unwrap_or(f64::NAN);
        let _ = writeln!(out, "| {name} | {median:.digits$}{unit} | {most:.digits$}{unit} | {number} |");
    };
    let hidden = || lines.iter().filter(|l| !l.right.is_empty());
    let ambiguous = hidden().filter(|l| l.verdict == "Ambiguous");
    row("rivals in an ambiguous verdict", "", 0, ambiguous.map(|l| l.rivals(&l.sets) as f64).collect());
    row("error of a size", " %", 1, hidden().flat_map(|l| &l.errors).map(|e| 100.0 * e).collect());
    let spread = |spin: bool| hidden().filter(move |l| (l.kind == "spin varies") == spin);
    row(
        "reported spread of a size by launch (15 % was drawn)",
        " %",
        1,
        spread(false).filter_map(|l| l.spread).map(|s| 100.0 * s).collect(),
    );
    row(
        "reported spread of lift where spin varies (0.3/s was drawn)",
        "/s",
        2,
        spread(true).filter_map(|l| l.spread).collect(),
    );
    row("one diagnosis", " s", 2, lines.iter().map(|l| l.seconds).collect());
    out + "\n" + &matrix(lines)
}

fn shares(counts: &[(String, [usize; 2])]) -> String {
    rates(counts.iter().map(|(name, own)| (name.as_str(), *own)))
}

/// Summary figures.
fn figures(lines: &[ResultRow]) -> Vec<(String, [usize; 2])> {
    let hidden = |l: &ResultRow| !l.right.is_empty();
    let nothing = |l: &ResultRow| l.kind.starts_with("nothing");
    let outside = |l: &ResultRow| l.kind.starts_with("outside");
    let spin = |l: &ResultRow| l.kind == "spin varies";
    let twin = |l: &ResultRow| !l.clean_verdict.is_empty();
    let mut out = vec![
        count(lines, "right alone", hidden, ResultRow::right_alone),
        count(lines, format!("in the set (of {MAX_RIVALS} at most)"), hidden, |l| {
            l.in_set() && !l.right_alone()
        }),
        count(lines, "right or in the set", hidden, ResultRow::in_set),
        count(lines, "right alone where the library allows it", ResultRow::allowed, ResultRow::right_alone),
        count(
            lines,
            "right or in the set where the library allows it",
            ResultRow::allowed,
            ResultRow::in_set,
        ),
        count(lines, "wrong name", hidden, |l| l.verdict == "Named" && !l.within(&l.sets)),
        count(lines, "several sets, all wrong", hidden, |l| l.verdict == "Ambiguous" && !l.within(&l.sets)),
        count(lines, format!("in a set of more than {MAX_RIVALS}"), hidden, |l| {
            l.reported() && l.within(&l.sets) && !l.in_set()
        }),
        count(lines, "unknown though the library has it", hidden, |l| l.verdict == "Unknown"),
        count(lines, "none or too little though something is hidden", hidden, |l| {
            matches!(l.verdict.as_str(), "None" | "InsufficientData")
        }),
        count(lines, "the library allows it (clean twin right alone)", twin, ResultRow::allowed),
        count(lines, "nothing hidden: a name", nothing, |l| l.verdict == "Named"),
        count(lines, "nothing hidden: several sets", nothing, |l| l.verdict == "Ambiguous"),
        count(lines, "nothing hidden: unknown", nothing, |l| l.verdict == "Unknown"),
        count(lines, "outside the library: unknown", outside, |l| l.verdict == "Unknown"),
        count(lines, "outside the library: named", outside, |l| l.verdict == "Named"),
        count(lines, "spin varies: every set holds quadratic drag", spin, |l| l.holds("quadratic_drag")),
        count(lines, "spin varies: its size within 10 %", spin, |l| l.holds("quadratic_drag") && l.near()),
        count(lines, "spin varies: lift's spread reported", spin, |l| l.spread.is_some()),
        count(lines, "spin varies: all three", spin, |l| {
            l.holds("quadratic_drag") && l.near() && l.spread.is_some()
        }),
    ];
    let covered: Vec<bool> = lines.iter().flat_map(|l| l.covered.iter().copied()).collect();
    let held = covered.iter().filter(|c| **c).count();
    out.push(("95 % intervals that hold the truth (sizes)".into(), [held, covered.len()]));
    out
}

/// Main figures by kind and by hidden effect.
fn by_truth(lines: &[ResultRow]) -> Vec<(String, [usize; 2])> {
    let mut out = Vec::new();
    let mut both = |name: String, some: &dyn Fn(&ResultRow) -> bool| {
        out.push(count(lines, format!("{name}: right alone"), some, ResultRow::right_alone));
        out.push(count(lines, format!("{name}: right or in the set"), some, ResultRow::in_set));
    };
    for launches in ["alike", "unlike"] {
        both(format!("launches {launches}"), &|l| !l.right.is_empty() && l.launches == launches);
    }
    let of = |l: &ResultRow| l.right.first().map(|truth| format!("{} {truth}", l.kind));
    for truth in lines.iter().filter_map(of).collect::<BTreeSet<_>>() {
        both(truth.clone(), &|l| of(l).as_ref() == Some(&truth));
    }
    for kind in lines.iter().filter(|l| l.right.is_empty()).map(|l| &l.kind).collect::<BTreeSet<_>>() {
        let own = |l: &ResultRow| l.kind == *kind;
        out.push(count(lines, format!("{kind}: a name or several sets"), own, ResultRow::reported));
        out.push(count(lines, format!("{kind}: unknown"), own, |l| l.verdict == "Unknown"));
    }
    out
}

/// Confusion matrix of hidden effects and diagnoses.
fn matrix(lines: &[ResultRow]) -> String {
    let mut counts: BTreeMap<[String; 3], usize> = BTreeMap::new();
    for l in lines {
        let hidden = l.right.first().map_or(l.kind.clone(), |truth| format!("{}: {truth}", l.kind));
        let said = |verdict: &str, sets: &[String]| format!("{verdict} {}", sets.join(" or "));
        let clean = said(&l.clean_verdict, &l.clean_sets);
        *counts.entry([hidden, said(&l.verdict, &l.sets), clean]).or_default() += 1;
    }
    let mut out = String::from("| hidden | diagnosed | its clean twin | worlds |\n|---|---|---|---|\n");
    for ([hidden, found, clean], number) in &counts {
        let _ = writeln!(out, "| {hidden} | {found} | {clean} | {number} |");
    }
    out
}
