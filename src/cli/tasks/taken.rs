//! A family made of scenes: its solutions tried, its tasks certified, its files written.

use std::fmt;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result, within};
use iplw::progress::Progress;
use iplw::reality::certify::{Judged, Outcome, Search, tried};
use iplw::task::{CANDIDATE_SEED, FAMILY_FORMAT, Family, certified_beside, parse_family_beside, read_family};

use super::journal::Journal;
use crate::cli::computing::Threads;
use crate::cli::output;

/// Where the family goes, and how its tasks are certified.
#[derive(clap::Args)]
pub struct Options {
    /// The folder of families.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Valid actions of each task from which the share that solves it is taken, and from which a solution is if those that came with
    /// it do not do.
    #[arg(long, default_value_t = 200)]
    sample: usize,
    /// Seed of the search.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    threads: Threads,
}

/// A family to be.
pub struct Plan {
    pub name: String,
    /// One line.
    pub about: String,
    /// Density (kg/m^2), friction, restitution, share of velocity kept per second.
    pub real: [f64; 4],
    /// The part of the file that says what estimators start from, if not from what is usual.
    pub prior: String,
    /// Scenes, a line each.
    pub lines: String,
    /// Why others are no scenes.
    pub unsaid: Vec<String>,
}

/// What became of it.
pub struct Taken {
    name: String,
    /// Tasks there were.
    pub tasks: usize,
    /// Why some are no scenes.
    pub unsaid: Vec<String>,
    /// Solutions that came with them, those that cannot be placed, and those that solve.
    pub solutions: usize,
    invalid: usize,
    pub solve: usize,
    /// Tasks that one of their solutions solves.
    solved: usize,
    /// Tasks of the family, and those that are certified by one of their solutions.
    pub kept: usize,
    own: usize,
    /// Tasks that nothing which was tried solves, and those whose solutions do not survive; not known of a family that was there.
    left_out: Option<[usize; 2]>,
}

impl Options {
    /// Sees to threads and folder.
    pub fn prepare(&self) -> Result<()> {
        self.threads.take()?;
        within("--sample", self.sample as f64, 10.0, 100_000.0)?;
        output::directory("--out", &self.out)
    }
}

/// Makes the family, or goes on with one that was stopped.
pub fn take(plan: &Plan, options: &Options) -> Result<Taken> {
    let path = options.out.join(format!("{}.toml", plan.name));
    let lines = plan.lines.lines().count();
    let mut taken = Taken::of(plan);
    if lines == 0 {
        return Ok(taken);
    }
    let family = parsed(plan, &path, lines, options)?;
    taken.tries(&family)?;
    let beside = certified_beside(&path);
    let journal = path.with_extension("search.jsonl");
    if path.exists() {
        return taken.there(&family, &path);
    }
    let scenes = options.out.join(scenes_of(&plan.name));
    if std::fs::read_to_string(&scenes).ok().as_deref() != Some(&plan.lines) {
        let others = [&scenes, &beside].into_iter().find(|p| p.exists() && !journal.exists());
        if let Some(other) = others {
            let allowed = "another folder: there are files of another family of this name";
            return Err(Error::input("--out", other.display(), allowed));
        }
        output::write_whole(&scenes, plan.lines.as_bytes())?;
    }
    let mut search = Search::new(&family, options.seed, lines)?;
    let mut journal = Journal::open(&journal, &family, options.seed, lines, &mut search)?;
    seek(&mut search, &mut journal, &plan.name)?;
    taken.judge(&family, &search);
    if taken.kept > 0 {
        output::write_whole(&beside, search.certified().to_json().as_bytes())?;
        // Last: a folder with a family's file has all of the family.
        output::write_whole(&path, file(plan, taken.kept, options.sample).as_bytes())?;
        read_family(&path)?;
    } else {
        std::fs::remove_file(&scenes).map_err(|e| Error::io(&scenes, e))?;
    }
    journal.remove()?;
    Ok(taken)
}

/// Looks at all scenes.
fn seek(search: &mut Search, journal: &mut Journal, name: &str) -> Result<()> {
    let bar = output::Bar::new();
    let (plain, total) = (!std::io::stderr().is_terminal(), search.draws().candidates.len());
    loop {
        if !plain {
            bar.report(&format!("certifying {name}"), search.judged().len() as u64, total as u64)?;
        }
        let Some(judged) = search.step()? else { break };
        journal.add(judged)?;
    }
    bar.clear();
    Ok(())
}

fn scenes_of(name: &str) -> String {
    format!("{name}.scenes.jsonl")
}

fn parsed(plan: &Plan, path: &Path, tasks: usize, options: &Options) -> Result<Family> {
    let given = |_: &str| Ok(plan.lines.clone());
    parse_family_beside(&file(plan, tasks, options.sample), &given).map_err(|e| e.at(path.display()))
}

/// The family's file, with so many tasks.
fn file(plan: &Plan, tasks: usize, sample: usize) -> String {
    let Plan { name, about, prior, real: [density, friction, restitution, damping], .. } = plan;
    // As PHYRE deals: 60, 20 and 20 of a hundred.
    let fifth = tasks / 5;
    let train = tasks - 2 * fifth;
    let (about, scenes) = (format!("{about:?}"), scenes_of(name));
    format!(
        "# Made by `iplw tasks import`: docs/phyre_import.md.\n\nformat = {FAMILY_FORMAT:?}\nname = {name:?}\nabout = {about}\n\n\
         [candidates]\nscenes = {scenes:?}\n\n\
         [real]\ndensity = {density:?}\nfriction = {friction:?}\nrestitution = {restitution:?}\ndamping = {damping:?}\n{prior}\n\
         [tasks]\ntrain = {train}\nvalidation = {fifth}\ntest = {fifth}\nsample = {sample}\nin_real_world = true\n\
         bins = [{{ from = 0, to = 1, tasks = {tasks} }}]\n"
    )
}

impl Taken {
    /// The line above those of families.
    pub const HEADER: &'static str = "family                tasks said | solutions solve  not placed  tasks solved | imported  by their own | unsolved unstable";

    fn of(plan: &Plan) -> Taken {
        Taken {
            name: plan.name.clone(),
            tasks: plan.lines.lines().count() + plan.unsaid.len(),
            unsaid: plan.unsaid.clone(),
            solutions: 0,
            invalid: 0,
            solve: 0,
            solved: 0,
            kept: 0,
            own: 0,
            left_out: None,
        }
    }

    /// Tries the solutions.
    fn tries(&mut self, family: &Family) -> Result<()> {
        for draw in family.draws(CANDIDATE_SEED)?.candidates {
            let found = tried(family, &family.scene(&draw)?, family.solutions(&draw))?;
            self.solutions += found.len();
            self.invalid += found.iter().filter(|f| f.is_none()).count();
            let solve = found.iter().filter(|f| **f == Some(true)).count();
            self.solve += solve;
            self.solved += usize::from(solve > 0);
        }
        Ok(())
    }

    /// What is there already, if it is of this family.
    fn there(mut self, family: &Family, path: &Path) -> Result<Taken> {
        let own = read_family(path)?;
        if own.digest != family.digest {
            let allowed = "another folder: there is another family of this name";
            return Err(Error::input("--out", path.display(), allowed));
        }
        let beside = certified_beside(path);
        let text = std::fs::read_to_string(&beside).map_err(|e| Error::io(&beside, e))?;
        let certified = iplw::task::Certified::from_json(&text).map_err(|e| e.at(beside.display()))?;
        let draws = family.draws(CANDIDATE_SEED)?.candidates;
        for row in certified.rows {
            let own = draws.get(row.candidate).map_or(&[][..], |d| family.solutions(d));
            self.kept += 1;
            self.own += usize::from(own.iter().any(|a| a.values() == row.certificate.action));
        }
        eprintln!("  {}: all of it is there", self.name);
        Ok(self)
    }

    fn judge(&mut self, family: &Family, search: &Search) {
        let draws = &search.draws().candidates;
        let by_its_own = |j: &&Judged| {
            let own = family.solutions(&draws[j.candidate]);
            j.certificate.as_ref().is_some_and(|c| own.iter().any(|a| a.values() == c.action))
        };
        let count = |outcome| search.judged().iter().filter(|j| j.outcome == outcome).count();
        self.kept = count(Outcome::Certified);
        self.own = search.judged().iter().filter(by_its_own).count();
        // A share of none is within the range of all: what has no stable solution then has none at all.
        let none = |j: &&Judged| j.outcome == Outcome::Unstable && j.share == 0.0;
        let neither = search.judged().iter().filter(none).count();
        let unsolvable = count(Outcome::Unsolvable) + neither;
        self.left_out = Some([unsolvable, count(Outcome::Unstable) - neither]);
    }
}

impl fmt::Display for Taken {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let said = self.tasks - self.unsaid.len();
        let [unsolvable, unstable] =
            self.left_out.map_or(["-"; 2].map(String::from), |n| n.map(|n| n.to_string()));
        write!(
            f,
            "{:<21} {:>5} {said:>4} | {:>9} {:>5}  {:>10}  {:>12} | {:>8}  {:>12} | {unsolvable:>8} {unstable:>8}",
            self.name, self.tasks, self.solutions, self.solve, self.invalid, self.solved, self.kept, self.own
        )
    }
}
