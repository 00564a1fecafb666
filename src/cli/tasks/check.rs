//! `iplw tasks check`: whether a family's file makes tasks.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result, within};
use iplw::picture::{sheet_svg, svg_to_png};
use iplw::progress::Progress;
use iplw::reality::certify::{Judged, Outcome, Search};
use iplw::task::{Family, Placement, Scene, certified_beside, read_family};

use super::journal::Journal;
use crate::cli::computing::Threads;
use crate::cli::output;

/// What is looked for, and where the results go.
#[derive(clap::Args)]
pub struct Args {
    /// The family's file, TOML.
    file: PathBuf,
    /// Look for so many tasks in place of those the file wants, spread over its ranges alike: for a look. Nothing is written
    /// beside the file but what the search itself keeps.
    #[arg(long, value_name = "N")]
    tasks: Option<usize>,
    /// Give up after so many candidates; all of them are looked at if not given.
    #[arg(long, value_name = "N")]
    candidates: Option<usize>,
    /// Directory for a contact sheet (NAME.svg, NAME.png: the first hundred tasks, each with a solution in place), the certified
    /// tasks and a table of all candidates (NAME.csv).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Seed of the search.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    threads: Threads,
}

/// Tasks that a contact sheet shows.
const SHOWN: usize = 100;

pub fn run(args: &Args) -> Result<()> {
    args.threads.take()?;
    let family = read_family(&args.file)?;
    let wanted = args.tasks.unwrap_or(family.selection.wanted());
    within("--tasks", wanted as f64, 1.0, family.selection.wanted() as f64)?;
    if let Some(out) = &args.out {
        output::directory("--out", out)?;
    }
    let mut search = Search::new(&family, args.seed, wanted)?;
    let kept = match args.tasks {
        Some(n) => args.file.with_extension(format!("search-{n}.jsonl")),
        None => args.file.with_extension("search.jsonl"),
    };
    let mut journal = Journal::open(&kept, &family, args.seed, wanted, &mut search)?;
    seek(&mut search, &mut journal, wanted, args.candidates.unwrap_or(usize::MAX))?;

    output::print(&told(&family, &search, wanted))?;
    if let Some(out) = &args.out {
        write(out, &family, &search)?;
    }
    if search.found() < wanted {
        return Err(Error::Failed(format!("not fit: {}", advice(&family, &search, wanted))));
    }
    if args.tasks.is_none() {
        let beside = certified_beside(&args.file);
        output::write_whole(&beside, search.certified().to_json().as_bytes())?;
        output::print(&format!("  certified tasks: {}\n", beside.display()))?;
    }
    journal.remove()
}

/// Looks at candidates until all tasks are found, or there are no more, or `most` were looked at.
fn seek(search: &mut Search, journal: &mut Journal, wanted: usize, most: usize) -> Result<()> {
    let bar = output::Bar::new();
    let plain = !std::io::stderr().is_terminal();
    let most = most.min(search.draws().candidates.len());
    while search.judged().len() < most {
        bar.report("certifying tasks", search.found() as u64, wanted as u64)?;
        let Some(judged) = search.step()? else { break };
        journal.add(judged)?;
        let (candidate, share) = (judged.candidate, 100.0 * judged.share);
        if plain && judged.outcome == Outcome::Certified {
            let found = search.found();
            eprintln!("  {found} of {wanted} tasks: candidate {candidate}, {share:.1} % of actions solve it");
        }
    }
    bar.clear();
    Ok(())
}

/// What was found, as a text.
fn told(family: &Family, search: &Search, wanted: usize) -> String {
    let draws = search.draws();
    let mut text = format!("{}: {}\n", family.name, family.about);
    text += &format!("  {} candidates of {} draws", draws.candidates.len(), draws.tried);
    let unmet = family.requirements().zip(&draws.unmet).filter(|(_, n)| **n > 0);
    let reasons: Vec<String> = unmet.map(|(rule, n)| format!("{n} do not meet `{rule}`")).collect();
    text += &if reasons.is_empty() { "\n".into() } else { format!(" ({})\n", reasons.join(", ")) };
    let world = if family.selection.in_real_world { "the real world" } else { "the undamped real world" };
    text += &format!("  share of valid actions that solve, in {world}: tasks found of those wanted\n");
    let (mut found, bins) = (vec![0; family.selection.bins.len()], &family.selection.bins);
    search
        .judged()
        .iter()
        .filter(|j| j.certificate.is_some())
        .filter_map(|j| j.bin)
        .for_each(|b| found[b] += 1);
    for ((bin, found), room) in bins.iter().zip(found).zip(search.room()) {
        let (from, to) = (100.0 * bin.from, 100.0 * bin.to);
        text += &format!("    {from:5.1} to {to:5.1} %  {found:4} of {}\n", found + room);
    }
    text += &format!("  {} candidates looked at:\n", search.judged().len());
    for (outcome, said) in OUTCOMES {
        let n = count(search, outcome);
        text += &if n > 0 { format!("    {n:5} {said}\n") } else { String::new() };
    }
    text + &format!("  {} of {wanted} tasks\n", search.found())
}

const OUTCOMES: [(Outcome, &str); 8] = [
    (Outcome::Certified, "tasks"),
    (Outcome::Unsolvable, "unsolvable: no action that was tried solves them"),
    (Outcome::TooHard, "too hard: fewer actions solve them than any range wants"),
    (Outcome::TooEasy, "too easy: more actions solve them than any range wants"),
    (
        Outcome::ByItself,
        "by themselves: in the other world, with or without what is hidden, more than half of the actions solve them",
    ),
    (Outcome::NotWanted, "in a range that is full, or between ranges"),
    (Outcome::Unstable, "unstable: no solution that was tried survives 40 perturbed copies of it"),
    (Outcome::NoScene, "no scene: things overlap, or a number is out of bounds"),
];

fn count(search: &Search, outcome: Outcome) -> usize {
    search.judged().iter().filter(|j| j.outcome == outcome).count()
}

/// What would help, by what most candidates are that are no tasks.
fn advice(family: &Family, search: &Search, wanted: usize) -> String {
    let most = OUTCOMES[1..].iter().map(|(o, _)| *o).max_by_key(|o| count(search, *o));
    let help = match most.filter(|o| count(search, *o) > 0) {
        Some(Outcome::Unsolvable | Outcome::TooHard) => {
            "an easier goal, a larger action space or lower ranges"
        }
        Some(Outcome::TooEasy) => "a harder goal or higher ranges",
        Some(Outcome::ByItself) => "a scene in which nothing happens by itself, or less damping",
        Some(Outcome::Unstable) => "a goal with more tolerance, or less that balances",
        Some(Outcome::NoScene) => "requirements that keep things apart (`candidates.require`)",
        _ => "ranges where candidates are, or more candidates (`candidates.count`)",
    };
    let looked = search.judged().len();
    format!(
        "{} of {wanted} tasks of {} among {looked} candidates; what helps: {help}",
        search.found(),
        family.name
    )
}

/// Contact sheet, certified tasks and the table of candidates.
fn write(out: &Path, family: &Family, search: &Search) -> Result<()> {
    let file = |ending: &str| out.join(format!("{}.{ending}", family.name));
    let tasks = search.judged().iter().filter(|j| j.certificate.is_some()).take(SHOWN).enumerate();
    let cells: Vec<(String, Scene)> =
        tasks.map(|(i, j)| cell(family, search, i, j)).collect::<Result<_>>()?;
    let svg = sheet_svg(&format!("{}: {}", family.name, family.about), &cells);
    output::write_whole(&file("svg"), svg.as_bytes())?;
    output::write_whole(&file("png"), &svg_to_png(&svg, 160 * cells.len().clamp(4, 10) as u32)?)?;
    output::write_whole(&file("certified.json"), search.certified().to_json().as_bytes())?;
    let header = ["candidate", "outcome", "solving_share"].into_iter().chain(family.parameters());
    let row = |j: &Judged| {
        let said = serde_json::to_value(j.outcome).map(|v| v.as_str().unwrap_or_default().to_string());
        let own = [j.candidate.to_string(), said.unwrap_or_default(), j.share.to_string()];
        own.into_iter().chain(search.draws().candidates[j.candidate].iter().map(f64::to_string)).collect()
    };
    let table = output::csv(&header.collect::<Vec<_>>(), search.judged().iter().map(row))?;
    output::write_whole(&file("csv"), &table)?;
    output::print(&format!("  contact sheet: {}\n", file("png").display()))
}

/// A task with its certified solution in place.
fn cell(family: &Family, search: &Search, number: usize, judged: &Judged) -> Result<(String, Scene)> {
    let scene = family.scene(&search.draws().candidates[judged.candidate])?;
    let caption = format!("{number:03}: {:.1} %", 100.0 * judged.share);
    let (Some(space), Some(certificate)) = (&scene.action, &judged.certificate) else {
        return Ok((caption, scene));
    };
    let action = space.validate(&certificate.action)?;
    Ok(match space.place(&scene, &action) {
        Placement::Valid(placed) => (caption, *placed),
        Placement::Invalid(_) => (caption, scene),
    })
}
