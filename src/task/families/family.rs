//! A family of tasks, parsed from its file.

use super::candidate_sampler::CandidateDraws;
use super::candidate_source::CandidateSource;
use super::certificate::{CANDIDATE_SEED, CertifiedRow, CertifiedTasks, Selection};
use super::claims::Claims;
use super::presets::Learning;
use super::real::RealPhysics;
use crate::error::{Error, Result};
use crate::task::scene::Scene;
use crate::task::{Split, Task, ValidAction};

/// A family of tasks with the same action space, kind of goal and hidden physics.
pub struct Family {
    /// Name on the command line and in URLs.
    pub name: &'static str,
    /// One-sentence description.
    pub about: &'static str,
    /// Id of the Gymnasium environment; empty if the Python package registers none.
    pub gymnasium: &'static str,
    /// Number of tasks in (train, validation, test).
    pub split: [usize; 3],
    /// The family's standard real world, sealed: `reality::standard` builds the world.
    pub real_physics: RealPhysics,
    /// Selection of tasks among the candidates.
    pub selection: Selection,
    /// Default prior of an estimator: (mean, standard deviation) of density, friction, restitution.
    pub prior: [(f64, f64); 3],
    /// Default training settings of policies.
    pub learning: Learning,
    /// Number of actions of each task that a performance surface samples: enough for most tasks to have a
    /// solution among them.
    pub surface_actions: usize,
    /// Claims of the paper that experiments check for this family.
    pub claims: Claims,
    /// Digest of everything that the certified tasks depend on.
    pub digest: String,
    /// The source of the candidates.
    pub(super) source: CandidateSource,
    /// The certified tasks.
    pub(super) tasks: Vec<Task>,
}

impl Family {
    /// The family; errors unless some candidate is a valid scene.
    pub(super) fn checked(self) -> Result<Family> {
        let draws = self.draws(CANDIDATE_SEED)?;
        // An error common to all scenes also occurs in the first; single invalid candidates are
        // skipped.
        let tried: Vec<Result<Scene>> =
            draws.candidates.iter().take(MAX_CHECKED_CANDIDATES).map(|d| self.scene(d)).collect();
        same_actions(tried.iter().flatten())?;
        match tried.into_iter().reduce(|first, next| first.or_else(|error| next.map_err(|_| error))) {
            Some(Err(error)) => Err(error),
            _ => Ok(self),
        }
    }

    /// The family with its certified tasks.
    pub(super) fn with_tasks(mut self, certified: CertifiedTasks) -> Result<Family> {
        for (field, found, wanted) in
            [("family", &certified.family, self.name), ("digest", &certified.digest, &self.digest)]
        {
            if found != wanted {
                let allowed = format!("{wanted:?}: the family has changed since; certify its tasks again");
                return Err(Error::input(field, format!("{found:?}"), allowed));
            }
        }
        let wanted: usize = self.split.iter().sum();
        if certified.rows.len() != wanted {
            let value = format!("{} tasks", certified.rows.len());
            return Err(Error::input("rows", value, format!("{wanted}, the number in the family's file")));
        }
        let draws = self.draws(CANDIDATE_SEED)?.candidates;
        let rows = certified.rows.into_iter().zip(assign_splits(self.split, 0)).enumerate();
        let task = |(number, (row, split)): (usize, (CertifiedRow, Split))| {
            let Some(draw) = draws.get(row.candidate) else {
                let field = format!("rows[{number}].candidate");
                return Err(Error::input(field, row.candidate, format!("a number below {}", draws.len())));
            };
            let scene = self.scene(draw).map_err(|e| e.in_field(&format!("rows[{number}]")))?;
            let actions = scene.action.as_ref().expect("a candidate has an action space: checked");
            actions.validate(&row.certificate.action).map_err(|e| e.in_field(&format!("rows[{number}]")))?;
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

    /// Prior means of density (kg/m^2), friction and restitution: the latents of an uncalibrated simulation.
    pub fn prior_means(&self) -> [f64; 3] {
        self.prior.map(|(mean, _)| mean)
    }

    /// All tasks in order of number, with certificates.
    pub fn tasks(&self) -> Vec<Task> {
        self.tasks.clone()
    }

    /// Names of the sampled parameters, in order.
    pub fn parameters(&self) -> impl Iterator<Item = &str> {
        self.source.parameters().into_iter()
    }

    /// Texts of the requirements, in order.
    pub fn requirements(&self) -> impl Iterator<Item = &str> {
        self.source.requirements().into_iter()
    }

    /// The sampled candidates for a seed, in the order in which the certifier tests them.
    pub fn draws(&self, seed: u64) -> Result<CandidateDraws> {
        self.source.draws(self.name, seed)
    }

    /// The valid scenes of all candidates, in that order.
    pub fn candidates(&self, seed: u64) -> impl Iterator<Item = Scene> {
        let draws = self.draws(seed).map(|d| d.candidates).unwrap_or_default();
        draws.into_iter().filter_map(|draw| self.scene(&draw).ok())
    }

    /// The scene of a candidate, with goal and action space; an error if it is invalid, for example
    /// because objects overlap. What carries latents has the prior's means, whatever the file says: a scene
    /// is the uncalibrated simulation and contains nothing of the real world.
    pub fn scene(&self, draw: &[f64]) -> Result<Scene> {
        Ok(self.source.scene(self.name, draw)?.with_carriers(self.prior_means()))
    }

    /// Solutions that the author of the scene provided.
    pub fn solutions(&self, draw: &[f64]) -> &[ValidAction] {
        self.source.solutions(draw)
    }

    /// All tasks with a new assignment to splits. Fold 0 is the assignment of [`Family::tasks`].
    ///
    /// Source: PHYRE's folds (Bakhtin et al. 2019, section 3): results over folds do not depend on one
    /// assignment.
    pub fn fold(&self, fold: u64) -> Vec<Task> {
        let dealt = assign_splits(self.split, fold);
        self.tasks().into_iter().zip(dealt).map(|(task, split)| Task { split, ..task }).collect()
    }
}

/// Errors unless all scenes have the same action space.
fn same_actions<'a>(mut scenes: impl Iterator<Item = &'a Scene>) -> Result<()> {
    let first = scenes.next().and_then(|s| s.action.as_ref());
    if scenes.all(|s| s.action.as_ref() == first) {
        return Ok(());
    }
    let allowed = "the same in all candidates, without sampled numbers";
    Err(Error::input("scene.action", "not the same in all candidates", allowed))
}

/// Number of candidates tested before a family is rejected as one without valid scenes.
const MAX_CHECKED_CANDIDATES: usize = 20;

/// Assigns tasks to splits: a seeded shuffle, then the first to train, the next to validation, the rest to
/// test; in order of task number.
fn assign_splits(counts: [usize; 3], seed: u64) -> Vec<Split> {
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
