//! What a family of tasks is, once its file is read.

use super::certified::{CANDIDATE_SEED, Certified, CertifiedRow, Selection};
use super::claims::Claims;
use super::draw::Draws;
use super::presets::Learning;
use super::real::RealPhysics;
use super::source::Source;
use crate::error::{Error, Result};
use crate::task::scene::Scene;
use crate::task::{Split, Task, ValidAction};

/// A family of tasks that share an action space, a kind of goal and what is hidden.
pub struct Family {
    /// Name on the command line and in URLs.
    pub name: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// Id under which Gymnasium makes the environment; empty if the Python package knows none.
    pub gymnasium: &'static str,
    /// How many tasks go to (train, validation, test).
    pub split: [usize; 3],
    /// The family's standard real world, sealed: `reality::standard` makes it into a world.
    pub real_physics: RealPhysics,
    /// How tasks are picked among the candidates.
    pub selection: Selection,
    /// What an estimator may start from: (mean, standard deviation) of density, friction, restitution.
    pub prior: [(f64, f64); 3],
    /// How policies are trained if nobody says otherwise.
    pub learning: Learning,
    /// Actions of each task that a performance surface samples: enough that something solves most tasks.
    pub surface_actions: usize,
    /// Statements of the paper that experiments check for this family.
    pub claims: Claims,
    /// Of what certified tasks depend on.
    pub digest: String,
    /// Where candidates are from.
    pub(super) source: Source,
    /// What was certified.
    pub(super) tasks: Vec<Task>,
}

impl Family {
    /// The family, if some draw makes a scene.
    pub(super) fn checked(self) -> Result<Family> {
        let draws = self.draws(CANDIDATE_SEED)?;
        // What is wrong with every scene is wrong with the first; what is wrong with some of them may not be.
        let tried: Vec<Result<Scene>> = draws.candidates.iter().take(TRIED).map(|d| self.scene(d)).collect();
        same_actions(tried.iter().flatten())?;
        match tried.into_iter().reduce(|first, next| first.or_else(|error| next.map_err(|_| error))) {
            Some(Err(error)) => Err(error),
            _ => Ok(self),
        }
    }

    /// The family with the tasks that were certified for it.
    pub(super) fn with(mut self, certified: Certified) -> Result<Family> {
        for (field, found, wanted) in
            [("family", &certified.family, self.name), ("digest", &certified.digest, &self.digest)]
        {
            if found != wanted {
                let allowed = format!("{wanted:?}: the family was changed, certify its tasks anew");
                return Err(Error::input(field, format!("{found:?}"), allowed));
            }
        }
        let wanted: usize = self.split.iter().sum();
        if certified.rows.len() != wanted {
            let value = format!("{} tasks", certified.rows.len());
            return Err(Error::input("rows", value, format!("{wanted}, as the family's file says")));
        }
        let draws = self.draws(CANDIDATE_SEED)?.candidates;
        let rows = certified.rows.into_iter().zip(deal(self.split, 0)).enumerate();
        let task = |(number, (row, split)): (usize, (CertifiedRow, Split))| {
            let Some(draw) = draws.get(row.candidate) else {
                let field = format!("rows[{number}].candidate");
                return Err(Error::input(field, row.candidate, format!("a number below {}", draws.len())));
            };
            let scene = self.scene(draw).map_err(|e| e.under(&format!("rows[{number}]")))?;
            let actions = scene.action.as_ref().expect("a candidate has an action space: checked");
            actions.validate(&row.certificate.action).map_err(|e| e.under(&format!("rows[{number}]")))?;
            Ok(Task {
                id: format!("{}:{number:03}", self.name),
                family: self.name.to_string(),
                split,
                scene,
                certificate: Some(row.certificate),
            })
        };
        self.tasks = rows.map(task).collect::<Result<_>>()?;
        same_actions(self.tasks.iter().map(|t| &t.scene))?;
        Ok(self)
    }

    /// All tasks in order of number; certificates included.
    pub fn tasks(&self) -> Vec<Task> {
        self.tasks.clone()
    }

    /// Names of what is drawn, in order.
    pub fn parameters(&self) -> impl Iterator<Item = &str> {
        self.source.parameters().into_iter()
    }

    /// What must hold of a draw, in order.
    pub fn requirements(&self) -> impl Iterator<Item = &str> {
        self.source.requirements().into_iter()
    }

    /// The numbers of the candidates in the order in which the certifier tries them, for a seed.
    pub fn draws(&self, seed: u64) -> Result<Draws> {
        self.source.draws(self.name, seed)
    }

    /// The scenes of all draws that make one, in that order.
    pub fn candidates(&self, seed: u64) -> impl Iterator<Item = Scene> {
        let draws = self.draws(seed).map(|d| d.candidates).unwrap_or_default();
        draws.into_iter().filter_map(|draw| self.scene(&draw).ok())
    }

    /// The scene of a draw, with goal and action space. An error if it is none: if things overlap, for one.
    pub fn scene(&self, draw: &[f64]) -> Result<Scene> {
        self.source.scene(self.name, draw)
    }

    /// Actions that are said to solve the scene of a draw, by whoever wrote it.
    pub fn solutions(&self, draw: &[f64]) -> &[ValidAction] {
        self.source.solutions(draw)
    }

    /// All tasks, dealt anew to the splits. Fold 0 is how [`Family::tasks`] deals them.
    ///
    /// Source: PHYRE's folds (Bakhtin et al. 2019, section 3): figures over folds hold for tasks that happen not to be
    /// in one of them, too.
    pub fn fold(&self, fold: u64) -> Vec<Task> {
        let dealt = deal(self.split, fold);
        self.tasks().into_iter().zip(dealt).map(|(task, split)| Task { split, ..task }).collect()
    }
}

/// What is said of a family's action space holds for each of its tasks.
fn same_actions<'a>(mut scenes: impl Iterator<Item = &'a Scene>) -> Result<()> {
    let first = scenes.next().and_then(|s| s.action.as_ref());
    if scenes.all(|s| s.action.as_ref() == first) {
        return Ok(());
    }
    let allowed = "the same in all candidates: numbers of a draw may not be in it";
    Err(Error::input("scene.action", "not the same in all candidates", allowed))
}

/// Candidates that are looked at before a family counts as one without scenes.
const TRIED: usize = 20;

/// Deals `n` tasks to splits: a seeded shuffle, then the first to train, the next to validation, the rest to
/// test; returned in order of task number.
fn deal(counts: [usize; 3], seed: u64) -> Vec<Split> {
    use rand::seq::SliceRandom;
    let n = counts.iter().sum();
    let mut order: Vec<usize> = (0..n).collect();
    order.shuffle(&mut crate::rng::stream(seed, "split"));
    let mut splits = vec![Split::Test; n];
    for (place, task) in order.into_iter().enumerate() {
        splits[task] = match place {
            p if p < counts[0] => Split::Train,
            p if p < counts[0] + counts[1] => Split::Validation,
            _ => Split::Test,
        };
    }
    splits
}
