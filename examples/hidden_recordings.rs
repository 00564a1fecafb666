//! Hides effects in worlds as recordings are, has them diagnosed, and counts how often the diagnosis is right.
//!
//! `cargo run --release --example hidden_recordings -- --worlds 400 --out rates.md`: that many worlds, kind after kind
//! (`--only KIND`: those in whose kind's name that is). `--seed` draws other worlds, `--threads` studies several at once,
//! each on one thread. Each world's outcome is added to `recordings.csv` beside the table as soon as it is known, and a run
//! that was stopped goes on where it was.
//!
//! What can be told apart at all is decided by the same method on the same launches without noise and dirt (the clean
//! twin). Sets that no such data can tell apart count as one: gravity, scale and clock in free flight; a tilted camera and
//! wind along x; and, where spin varies, quadratic drag with and without lift.

#[path = "../tests/discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::time::Instant;

use clap::CommandFactory as _;
use iplw::discover::report::{Diagnosis, FoundParameter, Verdict};
use iplw::discover::{Config, diagnose};
use iplw::progress::Silent;
use iplw::reality::Trial;
use worlds::recorded::{Kind, Size, World, kinds, world};
use worlds::study::{Run, middle, rates, sets, weighed};

/// Most sets that a reported set may hold and still count.
const MOST_RIVALS: usize = 4;
/// Share by which the drag of a ball whose spin varies may be off.
const NEAR: f64 = 0.1;

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
        kind.contains(&run.only).then(|| format!("{id},{}\n", study(&world(i, run.seed), id, i, run.talk)))
    })?;
    let lines: Vec<Line> = log.lines().filter_map(Line::read).collect();
    run.tell(&table(&lines))
}

/// A world's line without its id; see [`Line`].
fn study(world: &World, id: &str, seed: u64, talk: bool) -> String {
    let look = |trials: &[Trial]| {
        let from = Instant::now();
        match diagnose(&world.scene, trials, &Config::standard(seed), &Silent) {
            Ok(found) => (found.diagnosis, from.elapsed().as_secs_f64()),
            Err(e) => panic!("world {id} could not be diagnosed: {e}"),
        }
    };
    let (d, seconds) = look(&world.trials);
    let twin = matches!(world.kind, Kind::Single(_) | Kind::Pair(_) | Kind::Contact(_));
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
    if talk {
        eprintln!("{id},{line}");
        weighed(&d);
    }
    line
}

/// Relative errors of the hidden sizes in the reported set, if all that is reported is right (or spin varies), whether
/// intervals hold them (each joined by `+`), and a spread: of lift where spin varies, of the first size over that size
/// elsewhere.
fn compared(world: &World, d: &Diagnosis) -> (String, String, String) {
    let found = |effect: &str, parameter: &str| -> Option<&FoundParameter> {
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
    // By a clock that runs fast the same drag is less: beside a twin a size is another.
    if told.len() < world.sizes.len() {
        return Default::default();
    }
    let error = |(s, p): &(&Size, &FoundParameter)| {
        format!("{:.4}", ((p.value - s.value) / (s.value - s.neutral)).abs())
    };
    let covers = |(s, p): &(&Size, &FoundParameter)| match p.ci95 {
        [Some(a), Some(b)] => Some(u8::from((a..=b).contains(&s.value)).to_string()),
        _ => None,
    };
    let spread = match world.kind {
        // In the set or beside it: either way it is in the report.
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

/// How far a parameter differs by launch, where a report says so.
fn spread(parameter: &FoundParameter) -> Option<f64> {
    serde_json::to_value(parameter).ok()?.get("spread")?.as_f64()
}

/// A world's line in the log. Sets are names joined by `+`, several are joined by `|`.
struct Line {
    kind: String,
    /// Sets that are right.
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

impl Line {
    fn read(row: &str) -> Option<Line> {
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
        Some(Line {
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

    /// Whether a right set is among some.
    fn within(&self, sets: &[String]) -> bool {
        sets.iter().any(|s| self.right.contains(s))
    }

    /// How many sets are reported, of which all that are right count as one.
    fn rivals(&self, sets: &[String]) -> usize {
        sets.iter().filter(|s| !self.right.contains(s)).count() + usize::from(self.within(sets))
    }

    fn one_and_right(&self, verdict: &str, sets: &[String]) -> bool {
        matches!(verdict, "Named" | "Ambiguous") && self.within(sets) && self.rivals(sets) == 1
    }

    fn right_alone(&self) -> bool {
        self.one_and_right(&self.verdict, &self.sets)
    }

    /// Whether the same method names it where nothing errs.
    fn allowed(&self) -> bool {
        self.one_and_right(&self.clean_verdict, &self.clean_sets)
    }

    fn reported(&self) -> bool {
        matches!(self.verdict.as_str(), "Named" | "Ambiguous")
    }

    fn in_set(&self) -> bool {
        self.reported() && self.within(&self.sets) && self.rivals(&self.sets) <= MOST_RIVALS
    }

    /// Whether every reported set holds an effect.
    fn holds(&self, effect: &str) -> bool {
        self.reported() && self.sets.iter().all(|s| s.split('+').any(|n| n == effect))
    }

    fn near(&self) -> bool {
        self.errors.first().is_some_and(|e| *e <= NEAR)
    }
}

/// How often something holds of some of the worlds.
fn count(
    lines: &[Line],
    name: impl Into<String>,
    some: impl Fn(&Line) -> bool,
    holds: impl Fn(&Line) -> bool,
) -> (String, [usize; 2]) {
    let some: Vec<&Line> = lines.iter().filter(|l| some(l)).collect();
    (name.into(), [some.iter().filter(|l| holds(l)).count(), some.len()])
}

fn table(lines: &[Line]) -> String {
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

/// The figures that are asked for.
fn figures(lines: &[Line]) -> Vec<(String, [usize; 2])> {
    let hidden = |l: &Line| !l.right.is_empty();
    let nothing = |l: &Line| l.kind.starts_with("nothing");
    let outside = |l: &Line| l.kind.starts_with("outside");
    let spin = |l: &Line| l.kind == "spin varies";
    let twin = |l: &Line| !l.clean_verdict.is_empty();
    let mut out = vec![
        count(lines, "right alone", hidden, Line::right_alone),
        count(lines, format!("in the set (of {MOST_RIVALS} at most)"), hidden, |l| {
            l.in_set() && !l.right_alone()
        }),
        count(lines, "right or in the set", hidden, Line::in_set),
        count(lines, "right alone where the library allows it", Line::allowed, Line::right_alone),
        count(lines, "right or in the set where the library allows it", Line::allowed, Line::in_set),
        count(lines, "wrong name", hidden, |l| l.verdict == "Named" && !l.within(&l.sets)),
        count(lines, "several sets, all wrong", hidden, |l| l.verdict == "Ambiguous" && !l.within(&l.sets)),
        count(lines, format!("in a set of more than {MOST_RIVALS}"), hidden, |l| {
            l.reported() && l.within(&l.sets) && !l.in_set()
        }),
        count(lines, "unknown though the library has it", hidden, |l| l.verdict == "Unknown"),
        count(lines, "none or too little though something is hidden", hidden, |l| {
            matches!(l.verdict.as_str(), "None" | "InsufficientData")
        }),
        count(lines, "the library allows it (clean twin right alone)", twin, Line::allowed),
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

/// The main figures kind by kind, and by what was hidden.
fn by_truth(lines: &[Line]) -> Vec<(String, [usize; 2])> {
    let mut out = Vec::new();
    let mut both = |name: String, some: &dyn Fn(&Line) -> bool| {
        out.push(count(lines, format!("{name}: right alone"), some, Line::right_alone));
        out.push(count(lines, format!("{name}: right or in the set"), some, Line::in_set));
    };
    for launches in ["alike", "unlike"] {
        both(format!("launches {launches}"), &|l| !l.right.is_empty() && l.launches == launches);
    }
    let of = |l: &Line| l.right.first().map(|truth| format!("{} {truth}", l.kind));
    for truth in lines.iter().filter_map(of).collect::<BTreeSet<_>>() {
        both(truth.clone(), &|l| of(l).as_ref() == Some(&truth));
    }
    for kind in lines.iter().filter(|l| l.right.is_empty()).map(|l| &l.kind).collect::<BTreeSet<_>>() {
        let own = |l: &Line| l.kind == *kind;
        out.push(count(lines, format!("{kind}: a name or several sets"), own, Line::reported));
        out.push(count(lines, format!("{kind}: unknown"), own, |l| l.verdict == "Unknown"));
    }
    out
}

/// What was hidden, and what was said of it.
fn matrix(lines: &[Line]) -> String {
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
