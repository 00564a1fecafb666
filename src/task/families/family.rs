//! What a family of tasks is, and what families are made with.

use super::certified::{CANDIDATE_SEED, CertifiedRow, Selection};
use super::claims::Claims;
use super::presets::Learning;
use super::real::RealPhysics;
use crate::task::scene::{Scene, Static};
use crate::task::shape::Rectangle;
use crate::task::{Split, Task};

/// A family of tasks that share an action space, a kind of goal and what is hidden.
pub struct Family {
    /// Name on the command line and in URLs.
    pub name: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// Id under which Gymnasium makes the environment.
    pub gymnasium: &'static str,
    /// All tasks in order of number; certificates included.
    pub tasks: fn() -> Vec<Task>,
    /// Candidate scenes in the order the certifier tries them, for a seed.
    pub candidates: fn(seed: u64) -> Vec<Scene>,
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
}

impl Family {
    /// All tasks, dealt anew to the splits. Fold 0 is how [`Family::tasks`] deals them.
    ///
    /// Source: PHYRE's folds (Bakhtin et al. 2019, section 3): figures over folds hold for tasks that happen not to be
    /// in one of them, too.
    pub fn fold(&self, fold: u64) -> Vec<Task> {
        let dealt = deal(self.split, fold);
        (self.tasks)().into_iter().zip(dealt).map(|(task, split)| Task { split, ..task }).collect()
    }
}

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

/// Assembles a family's tasks from its certified scenes.
pub(super) fn assemble(family: &Family, certified: &str, split_seed: u64) -> Vec<Task> {
    let rows: Vec<CertifiedRow> =
        serde_json::from_str(certified).expect("the certified tasks in the crate are well-formed: tested");
    let scenes = (family.candidates)(CANDIDATE_SEED);
    let splits = deal(family.split, split_seed);
    rows.into_iter()
        .zip(splits)
        .enumerate()
        .map(|(number, (row, split))| Task {
            id: format!("{}:{number:03}", family.name),
            family: family.name.to_string(),
            split,
            scene: scenes[row.candidate].clone(),
            certificate: Some(row.certificate),
        })
        .collect()
}

/// Four walls of `thickness` just outside a square of `side`, m.
pub(super) fn walls(side: f64, thickness: f64, friction: f64, restitution: f64) -> Vec<Static> {
    let half = side / 2.0;
    let (near, far) = (-thickness / 2.0, side + thickness / 2.0);
    let wall = |name: &str, position: [f64; 2], half_width: f64, half_height: f64| Static {
        name: name.into(),
        shape: Rectangle { half_width, half_height }.into(),
        friction,
        restitution,
        position,
        angle: 0.0,
    };
    vec![
        wall("floor", [half, near], half + thickness, thickness / 2.0),
        wall("ceiling", [half, far], half + thickness, thickness / 2.0),
        wall("left_wall", [near, half], thickness / 2.0, half),
        wall("right_wall", [far, half], thickness / 2.0, half),
    ]
}
