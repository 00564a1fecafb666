//! What is asked: scenes, what may be placed in them, goals, and the registry of task families.
//!
//! A family is one file and one row in [`FAMILIES`], a shape one file and one row in [`shape`]. Nothing here moves.

pub mod action;
mod basketball;
mod body;
mod bowling;
mod custom;
pub mod geometry;
mod goal;
mod limits;
mod placement;
pub mod scene;
mod setting;
pub mod shape;
pub mod solid;
mod validate;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
pub use action::{ActionSpace, ValidAction};
pub use custom::custom;
pub use placement::Placement;
pub use scene::Scene;

/// Every built-in task family.
pub static FAMILIES: [&Family; 2] = [&bowling::FAMILY, &basketball::FAMILY];

/// One single-action task: a scene with an action space and a goal.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// `family:number`, or a custom scene's name.
    pub id: String,
    /// Name of the family; `custom` for a user's scene.
    pub family: String,
    /// Which part of the family it belongs to.
    pub split: Split,
    /// The scene before any action; always has an action space.
    pub scene: Scene,
    /// Evidence that the task can be solved; absent for custom tasks.
    pub certificate: Option<Certificate>,
}

/// The part of a family a task belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    Train,
    Validation,
    Test,
}

/// A solution that survives small perturbations, and how easy the task is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// An action that solves the task in the family's real world, as do its perturbed neighbours.
    pub action: Vec<f64>,
    /// Seed of the search and of the perturbations.
    pub seed: u64,
    /// Share of valid discrete actions that solve the task in the family's real world, from a random sample.
    pub solving_share: f64,
    /// The same in the same world without its unmodelled effects.
    pub solving_share_undamped: f64,
}

/// A family of tasks that share an action space, a kind of goal and what is hidden.
pub struct Family {
    /// Name on the command line and in URLs.
    pub name: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// All tasks in order of number; certificates included.
    pub tasks: fn() -> Vec<Task>,
    /// Candidate scenes in the order the certifier tries them, for a seed.
    pub candidates: fn(seed: u64) -> Vec<Scene>,
    /// How many tasks go to (train, validation, test).
    pub split: [usize; 3],
    /// The family's standard real world. Only `reality/` may read it.
    pub real_physics: RealPhysics,
    /// How tasks are picked among the candidates.
    pub selection: Selection,
    /// What an estimator may start from: (mean, standard deviation) of density, friction, restitution.
    pub prior: [(f64, f64); 3],
}

/// Which candidates become tasks: so many within each range of the share of valid actions that solve them.
pub struct Selection {
    /// (least share, largest share, number of tasks)
    pub bins: &'static [(f64, f64, usize)],
    /// Whether the share is taken in the real world or in the same world without its unmodelled effects.
    pub in_real_world: bool,
    /// Valid actions sampled for each share.
    pub sample: usize,
}

/// The hidden side of a family's standard real world.
pub struct RealPhysics {
    /// kg/m^2
    pub density: f64,
    /// Surface coefficient of every carrier.
    pub friction: f64,
    /// Surface coefficient of every carrier.
    pub restitution: f64,
    /// Kept share of velocity per second, which the simulation does not know of.
    pub damping: f64,
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

impl Task {
    /// The task's action space.
    pub fn actions(&self) -> &ActionSpace {
        self.scene.action.as_ref().expect("a task's scene has an action space: checked where tasks are made")
    }

    /// Carries out an action on the task's scene.
    pub fn place(&self, action: &ValidAction) -> Placement {
        self.actions().place(&self.scene, action)
    }
}

impl Split {
    /// The name used on the wire and in ids.
    pub fn name(self) -> &'static str {
        match self {
            Split::Train => "train",
            Split::Validation => "validation",
            Split::Test => "test",
        }
    }
}

/// The family named `name`.
pub fn family(name: &str) -> Result<&'static Family> {
    FAMILIES.iter().copied().find(|f| f.name == name).ok_or_else(|| Error::NotFound {
        kind: "task family",
        id: name.to_string(),
        known: FAMILIES.iter().map(|f| f.name.to_string()).collect(),
    })
}

/// The tasks of one split.
pub fn split(tasks: &[Task], split: Split) -> Vec<Task> {
    tasks.iter().filter(|t| t.split == split).cloned().collect()
}

/// Deals `n` tasks to splits: a seeded shuffle, then the first to train, the next to validation, the rest to
/// test; returned in order of task number.
pub(crate) fn deal(counts: [usize; 3], seed: u64) -> Vec<Split> {
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
pub(crate) fn assemble(family: &Family, certified: &str, split_seed: u64) -> Vec<Task> {
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
fn walls(side: f64, thickness: f64, friction: f64, restitution: f64) -> Vec<scene::Static> {
    let half = side / 2.0;
    let (near, far) = (-thickness / 2.0, side + thickness / 2.0);
    let wall = |name: &str, position: [f64; 2], half_width: f64, half_height: f64| scene::Static {
        name: name.into(),
        shape: shape::Rectangle { half_width, half_height }.into(),
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

/// Seed from which the built-in families' candidates are drawn.
pub const CANDIDATE_SEED: u64 = 0;

/// One row of a family's file of certified tasks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CertifiedRow {
    /// Index into the family's candidates for [`CANDIDATE_SEED`].
    pub candidate: usize,
    /// The evidence.
    pub certificate: Certificate,
}
