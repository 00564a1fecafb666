//! `iplw tasks check`: certification of a family file.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result, check_range};
use iplw::picture::{contact_sheet_svg, svg_to_png};
use iplw::progress::Progress;
use iplw::reality::certify::{CandidateResult, CertificationOutcome, CertificationSearch};
use iplw::task::{Family, Placement, Scene, certified_beside, read_family};

use super::journal::Journal;
use crate::cli::common_options::ThreadOptions;
use crate::cli::output;

/// Options of the search.
#[derive(clap::Args)]
pub struct Args {
    /// Family file (TOML).
    file: PathBuf,
    /// Number of tasks, spread over the ranges, for a preview: nothing is certified [default: the file's]
    #[arg(long, value_name = "N")]
    tasks: Option<usize>,
    /// Maximal number of candidates [default: all]
    #[arg(long, value_name = "N")]
    candidates: Option<usize>,
    /// Output directory for a contact sheet, certified tasks and a table of candidates [default: none]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Random seed.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    threads: ThreadOptions,
}

/// Maximal number of tasks in a contact sheet.
const MAX_SHEET_TASKS: usize = 100;

pub fn run(args: &Args) -> Result<()> {
    args.threads.install()?;
    let family = read_family(&args.file)?;
    let wanted = args.tasks.unwrap_or(family.selection.n_tasks());
    check_range("--tasks", wanted as f64, 1.0, family.selection.n_tasks() as f64)?;
    if let Some(out) = &args.out {
        output::prepare_directory("--out", out)?;
    }
    let mut search = CertificationSearch::new(&family, args.seed, wanted)?;
    let journal_path = match args.tasks {
        Some(n) => args.file.with_extension(format!("search-{n}.jsonl")),
        None => args.file.with_extension("search.jsonl"),
    };
    let mut journal = Journal::open(&journal_path, &family, args.seed, wanted, &mut search)?;
    run_search(&mut search, &mut journal, wanted, args.candidates.unwrap_or(usize::MAX))?;

    output::print(&summary(&family, &search, wanted))?;
    if let Some(out) = &args.out {
        write(out, &family, &search)?;
    }
    if search.certified_count() < wanted {
        return Err(Error::Failed(format!("too few tasks: {}", advice(&family, &search, wanted))));
    }
    if args.tasks.is_none() {
        let certified_path = certified_beside(&args.file);
        output::write_whole(&certified_path, search.certified().to_json().as_bytes())?;
        output::print(&format!("  certified tasks: {}\n", certified_path.display()))?;
    }
    journal.remove()
}

/// Evaluates candidates until all tasks are found, or `most` candidates were evaluated.
fn run_search(
    search: &mut CertificationSearch,
    journal: &mut Journal,
    wanted: usize,
    most: usize,
) -> Result<()> {
    let bar = output::TerminalProgress::new();
    let plain = !std::io::stderr().is_terminal();
    let most = most.min(search.draws().candidates.len());
    while search.results().len() < most {
        bar.report("certifying tasks", search.certified_count() as u64, wanted as u64)?;
        let Some(judged) = search.step()? else { break };
        journal.add(judged)?;
        let (candidate, share) = (judged.candidate, 100.0 * judged.share);
        if plain && judged.outcome == CertificationOutcome::Certified {
            let found = search.certified_count();
            eprintln!("  {found} of {wanted} tasks: candidate {candidate}, {share:.1} % of actions solve it");
        }
    }
    bar.clear();
    Ok(())
}

/// Summary of a search as text.
fn summary(family: &Family, search: &CertificationSearch, wanted: usize) -> String {
    let draws = search.draws();
    let mut text = format!("{}: {}\n", family.name, family.about);
    text += &format!("  {} candidates of {} draws", draws.candidates.len(), draws.evaluated);
    let unmet = family.requirements().zip(&draws.unmet).filter(|(_, n)| **n > 0);
    let reasons: Vec<String> = unmet.map(|(rule, n)| format!("{n} do not meet `{rule}`")).collect();
    text += &if reasons.is_empty() { "\n".into() } else { format!(" ({})\n", reasons.join(", ")) };
    let world = if family.selection.in_real_world { "the real world" } else { "the undamped real world" };
    text += &format!(
        "  share of valid actions that solve in {world}: number of tasks found, of number requested\n"
    );
    let (mut found, bins) = (vec![0; family.selection.bins.len()], &family.selection.bins);
    search
        .results()
        .iter()
        .filter(|j| j.certificate.is_some())
        .filter_map(|j| j.bin)
        .for_each(|b| found[b] += 1);
    for ((bin, found), room) in bins.iter().zip(found).zip(search.open_slots()) {
        let (from, to) = (100.0 * bin.from, 100.0 * bin.to);
        text += &format!("    {from:5.1} to {to:5.1} %  {found:4} of {}\n", found + room);
    }
    text += &format!("  {} candidates evaluated:\n", search.results().len());
    for (outcome, label) in OUTCOMES {
        let n = count(search, outcome);
        text += &if n > 0 { format!("    {n:5} {label}\n") } else { String::new() };
    }
    text + &format!("  {} of {wanted} tasks\n", search.certified_count())
}

const OUTCOMES: [(CertificationOutcome, &str); 8] = [
    (CertificationOutcome::Certified, "tasks"),
    (CertificationOutcome::Unsolvable, "unsolvable: no sampled action solves them"),
    (CertificationOutcome::TooHard, "too hard: fewer actions solve them than in any range"),
    (CertificationOutcome::TooEasy, "too easy: more actions solve them than in any range"),
    (
        CertificationOutcome::ByItself,
        "trivial in the other world (with or without hidden physics): more than half of the actions solve them",
    ),
    (CertificationOutcome::NotWanted, "surplus: in a full range, or between ranges"),
    (CertificationOutcome::Unstable, "unstable: no solution survives 40 perturbations"),
    (CertificationOutcome::NoScene, "invalid scene: bodies overlap, or a number is out of bounds"),
];

fn count(search: &CertificationSearch, outcome: CertificationOutcome) -> usize {
    search.results().iter().filter(|j| j.outcome == outcome).count()
}

/// Advice for the most frequent reason of rejection.
fn advice(family: &Family, search: &CertificationSearch, wanted: usize) -> String {
    let most = OUTCOMES[1..].iter().map(|(o, _)| *o).max_by_key(|o| count(search, *o));
    let help = match most.filter(|o| count(search, *o) > 0) {
        Some(CertificationOutcome::Unsolvable | CertificationOutcome::TooHard) => {
            "an easier goal, a larger action space or lower ranges"
        }
        Some(CertificationOutcome::TooEasy) => "a harder goal or higher ranges",
        Some(CertificationOutcome::ByItself) => {
            "a scene that is not solved by doing nothing, or less damping"
        }
        Some(CertificationOutcome::Unstable) => "a goal with more tolerance, or fewer balanced bodies",
        Some(CertificationOutcome::NoScene) => "requirements that keep bodies apart (`candidates.require`)",
        _ => "ranges that match the candidates, or more candidates (`candidates.count`)",
    };
    let evaluated = search.results().len();
    format!(
        "{} of {wanted} tasks of {} among {evaluated} candidates; try {help}",
        search.certified_count(),
        family.name
    )
}

/// Contact sheet, certified tasks and the table of candidates.
fn write(out: &Path, family: &Family, search: &CertificationSearch) -> Result<()> {
    let file = |ending: &str| out.join(format!("{}.{ending}", family.name));
    let tasks = search.results().iter().filter(|j| j.certificate.is_some()).take(MAX_SHEET_TASKS).enumerate();
    let cells: Vec<(String, Scene)> =
        tasks.map(|(i, j)| cell(family, search, i, j)).collect::<Result<_>>()?;
    let svg = contact_sheet_svg(&format!("{}: {}", family.name, family.about), &cells);
    output::write_whole(&file("svg"), svg.as_bytes())?;
    output::write_whole(&file("png"), &svg_to_png(&svg, 160 * cells.len().clamp(4, 10) as u32)?)?;
    output::write_whole(&file("certified.json"), search.certified().to_json().as_bytes())?;
    let header = ["candidate", "outcome", "solving_share"].into_iter().chain(family.parameters());
    let row = |j: &CandidateResult| {
        let label = serde_json::to_value(j.outcome).map(|v| v.as_str().unwrap_or_default().to_string());
        let own = [j.candidate.to_string(), label.unwrap_or_default(), j.share.to_string()];
        own.into_iter().chain(search.draws().candidates[j.candidate].iter().map(f64::to_string)).collect()
    };
    let table = output::csv(&header.collect::<Vec<_>>(), search.results().iter().map(row))?;
    output::write_whole(&file("csv"), &table)?;
    output::print(&format!("  contact sheet: {}\n", file("png").display()))
}

/// A task with its certified solution applied.
fn cell(
    family: &Family,
    search: &CertificationSearch,
    number: usize,
    judged: &CandidateResult,
) -> Result<(String, Scene)> {
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
