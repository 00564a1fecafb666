//! Creation of a family from scenes: tests known solutions, certifies tasks, and writes the files.

use std::fmt;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result, check_range};
use iplw::progress::Progress;
use iplw::reality::certify::{CandidateResult, CertificationOutcome, CertificationSearch, solving_actions};
use iplw::task::{CANDIDATE_SEED, FAMILY_FORMAT, Family, certified_beside, parse_family_beside, read_family};

use super::journal::Journal;
use crate::cli::common_options::ThreadOptions;
use crate::cli::output;

// Options of imports.
#[derive(clap::Args)]
pub struct ImportOptions {
    /// Output directory of families.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Valid actions sampled per task for the solving share and for missing solutions.
    #[arg(long, default_value_t = 200)]
    sample: usize,
    /// Random seed.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    threads: ThreadOptions,
}

/// Input of a family.
pub struct FamilySource {
    pub name: String,
    /// One-line description.
    pub about: String,
    /// Density (kg/m^2), friction, restitution, share of velocity retained per second.
    pub real: [f64; 4],
    /// The `[prior]` section of the family file; empty for the default.
    pub prior: String,
    /// Scenes, one per line.
    pub lines: String,
    /// Errors of invalid scenes.
    pub rejected: Vec<String>,
}

/// Summary of an import.
pub struct ImportSummary {
    name: String,
    /// Number of tasks in the input.
    pub tasks: usize,
    /// Errors of invalid scenes.
    pub rejected: Vec<String>,
    /// Number of known solutions, of invalid ones, and of those that solve their task.
    pub solutions: usize,
    invalid: usize,
    pub solve: usize,
    /// Tasks solved by one of their known solutions.
    solved: usize,
    /// Tasks of the family, and those certified by one of their known solutions.
    pub imported: usize,
    certified_by_solution: usize,
    /// Number of unsolved and of unstable tasks; unknown for an existing family.
    rejected_tasks: Option<[usize; 2]>,
}

impl ImportOptions {
    /// Configures threads, checks options, and creates the directory.
    pub fn prepare(&self) -> Result<()> {
        self.threads.install()?;
        check_range("--sample", self.sample as f64, 10.0, 100_000.0)?;
        output::prepare_directory("--out", &self.out)
    }
}

/// Creates the family, or resumes an interrupted import.
pub fn import_family(plan: &FamilySource, options: &ImportOptions) -> Result<ImportSummary> {
    let path = options.out.join(format!("{}.toml", plan.name));
    let lines = plan.lines.lines().count();
    let mut summary = ImportSummary::of(plan);
    if lines == 0 {
        return Ok(summary);
    }
    let family = parse_source(plan, &path, lines, options)?;
    summary.try_solutions(&family)?;
    let certified_path = certified_beside(&path);
    let journal = path.with_extension("search.jsonl");
    if path.exists() {
        return summary.load_existing(&family, &path);
    }
    let scenes = options.out.join(scenes_file_name(&plan.name));
    if std::fs::read_to_string(&scenes).ok().as_deref() != Some(&plan.lines) {
        let others = [&scenes, &certified_path].into_iter().find(|p| p.exists() && !journal.exists());
        if let Some(other) = others {
            let allowed = "another directory: this one has files of another family of this name";
            return Err(Error::input("--out", other.display(), allowed));
        }
        output::write_whole(&scenes, plan.lines.as_bytes())?;
    }
    let mut search = CertificationSearch::new(&family, options.seed, lines)?;
    let mut journal = Journal::open(&journal, &family, options.seed, lines, &mut search)?;
    certify_scenes(&mut search, &mut journal, &plan.name)?;
    summary.summarise(&family, &search);
    if summary.imported > 0 {
        output::write_whole(&certified_path, search.certified().to_json().as_bytes())?;
        // Written last, so that a directory with a family file is complete.
        output::write_whole(&path, family_toml(plan, summary.imported, options.sample).as_bytes())?;
        read_family(&path)?;
    } else {
        std::fs::remove_file(&scenes).map_err(|e| Error::io(&scenes, e))?;
    }
    journal.remove()?;
    Ok(summary)
}

/// Evaluates all scenes.
fn certify_scenes(search: &mut CertificationSearch, journal: &mut Journal, name: &str) -> Result<()> {
    let bar = output::TerminalProgress::new();
    let (plain, total) = (!std::io::stderr().is_terminal(), search.draws().candidates.len());
    loop {
        if !plain {
            bar.report(&format!("certifying {name}"), search.results().len() as u64, total as u64)?;
        }
        let Some(judged) = search.step()? else { break };
        journal.add(judged)?;
    }
    bar.clear();
    Ok(())
}

fn scenes_file_name(name: &str) -> String {
    format!("{name}.scenes.jsonl")
}

fn parse_source(plan: &FamilySource, path: &Path, tasks: usize, options: &ImportOptions) -> Result<Family> {
    let given = |_: &str| Ok(plan.lines.clone());
    parse_family_beside(&family_toml(plan, tasks, options.sample), &given)
        .map_err(|e| e.in_file(path.display()))
}

/// The family file with `tasks` tasks.
fn family_toml(plan: &FamilySource, tasks: usize, sample: usize) -> String {
    let FamilySource { name, about, prior, real: [density, friction, restitution, damping], .. } = plan;
    // PHYRE's splits: 60, 20 and 20 %.
    let fifth = tasks / 5;
    let train = tasks - 2 * fifth;
    let (about, scenes) = (format!("{about:?}"), scenes_file_name(name));
    format!(
        "# Made by `iplw tasks import`: docs/how-to/import_tasks.md.\n\nformat = {FAMILY_FORMAT:?}\nname = {name:?}\nabout = {about}\n\n\
         [candidates]\nscenes = {scenes:?}\n\n\
         [real]\ndensity = {density:?}\nfriction = {friction:?}\nrestitution = {restitution:?}\ndamping = {damping:?}\n{prior}\n\
         [tasks]\ntrain = {train}\nvalidation = {fifth}\ntest = {fifth}\nsample = {sample}\nin_real_world = true\n\
         bins = [{{ from = 0, to = 1, tasks = {tasks} }}]\n"
    )
}

impl ImportSummary {
    /// Header of the table of families.
    pub const HEADER: &'static str = "family                tasks valid | solutions solve     invalid  tasks solved | imported  by solution | unsolved unstable";

    fn of(plan: &FamilySource) -> ImportSummary {
        ImportSummary {
            name: plan.name.clone(),
            tasks: plan.lines.lines().count() + plan.rejected.len(),
            rejected: plan.rejected.clone(),
            solutions: 0,
            invalid: 0,
            solve: 0,
            solved: 0,
            imported: 0,
            certified_by_solution: 0,
            rejected_tasks: None,
        }
    }

    /// Tests the known solutions.
    fn try_solutions(&mut self, family: &Family) -> Result<()> {
        for draw in family.draws(CANDIDATE_SEED)?.candidates {
            let found = solving_actions(family, &family.scene(&draw)?, family.solutions(&draw))?;
            self.solutions += found.len();
            self.invalid += found.iter().filter(|f| f.is_none()).count();
            let solve = found.iter().filter(|f| **f == Some(true)).count();
            self.solve += solve;
            self.solved += usize::from(solve > 0);
        }
        Ok(())
    }

    /// Loads an existing family, if it is the same.
    fn load_existing(mut self, family: &Family, path: &Path) -> Result<ImportSummary> {
        let own = read_family(path)?;
        if own.digest != family.digest {
            let allowed = "another directory: this one has another family of this name";
            return Err(Error::input("--out", path.display(), allowed));
        }
        let certified_path = certified_beside(path);
        let text = std::fs::read_to_string(&certified_path).map_err(|e| Error::io(&certified_path, e))?;
        let certified =
            iplw::task::CertifiedTasks::from_json(&text).map_err(|e| e.in_file(certified_path.display()))?;
        let draws = family.draws(CANDIDATE_SEED)?.candidates;
        for row in certified.rows {
            let own = draws.get(row.candidate).map_or(&[][..], |d| family.solutions(d));
            self.imported += 1;
            self.certified_by_solution +=
                usize::from(own.iter().any(|a| a.values() == row.certificate.action));
        }
        eprintln!("  {}: already complete", self.name);
        Ok(self)
    }

    fn summarise(&mut self, family: &Family, search: &CertificationSearch) {
        let draws = &search.draws().candidates;
        let by_its_own = |j: &&CandidateResult| {
            let own = family.solutions(&draws[j.candidate]);
            j.certificate.as_ref().is_some_and(|c| own.iter().any(|a| a.values() == c.action))
        };
        let count = |outcome| search.results().iter().filter(|j| j.outcome == outcome).count();
        self.imported = count(CertificationOutcome::Certified);
        self.certified_by_solution = search.results().iter().filter(by_its_own).count();
        // The range includes a share of zero, so unsolved tasks count as unstable in the search.
        let none = |j: &&CandidateResult| j.outcome == CertificationOutcome::Unstable && j.share == 0.0;
        let neither = search.results().iter().filter(none).count();
        let unsolvable = count(CertificationOutcome::Unsolvable) + neither;
        self.rejected_tasks = Some([unsolvable, count(CertificationOutcome::Unstable) - neither]);
    }
}

impl fmt::Display for ImportSummary {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let valid = self.tasks - self.rejected.len();
        let [unsolvable, unstable] =
            self.rejected_tasks.map_or(["-"; 2].map(String::from), |n| n.map(|n| n.to_string()));
        write!(
            f,
            "{:<21} {:>5} {valid:>5} | {:>9} {:>5}  {:>10}  {:>12} | {:>8}  {:>12} | {unsolvable:>8} {unstable:>8}",
            self.name,
            self.tasks,
            self.solutions,
            self.solve,
            self.invalid,
            self.solved,
            self.imported,
            self.certified_by_solution
        )
    }
}
