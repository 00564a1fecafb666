//! Families and tasks.

use serde::Serialize;
use utoipa::ToSchema;

use super::bulk::Bulk;
use super::episode::SplitIn;
use super::space::{ActionSpaceOut, ObservationSpaceOut};
use crate::session::observation;
use crate::task::{self, Family, Scene, Split, Task};

/// All families.
#[derive(Serialize, ToSchema)]
pub struct Families {
    pub families: Vec<FamilyOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// A family of tasks.
#[derive(Serialize, ToSchema)]
pub struct FamilyOut {
    pub name: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// Id under which Gymnasium makes the environment.
    pub gymnasium: &'static str,
    /// Number of tasks.
    pub tasks: usize,
    pub split: SplitCounts,
    pub action_space: Option<ActionSpaceOut>,
}

/// Numbers of tasks.
#[derive(Serialize, ToSchema)]
pub struct SplitCounts {
    pub train: usize,
    pub validation: usize,
    pub test: usize,
}

/// The tasks of a family.
#[derive(Serialize, ToSchema)]
pub struct FamilyTasks {
    pub name: &'static str,
    pub tasks: Vec<TaskRow>,
    pub action_space: ActionSpaceOut,
    pub observation_space: ObservationSpaceOut,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// A task without its scene.
#[derive(Serialize, ToSchema)]
pub struct TaskRow {
    pub id: String,
    pub split: SplitIn,
    pub certificate: Option<Certificate>,
}

/// A task with its scene.
#[derive(Serialize, ToSchema)]
pub struct TaskOut {
    pub id: String,
    pub split: SplitIn,
    /// An `iplw.scene/1` document.
    #[schema(value_type = Object)]
    pub scene: Scene,
    pub certificate: Option<Certificate>,
}

/// Evidence that a task can be solved.
#[derive(Serialize, ToSchema)]
pub struct Certificate {
    /// An action that solves the task and still does when perturbed.
    pub action: Vec<f64>,
    /// Seed of the search.
    pub seed: u64,
    /// Share of valid actions that solve it in the family's real world.
    pub solving_share: f64,
    /// The same without the real world's unmodelled effects.
    pub solving_share_undamped: f64,
}

impl FamilyOut {
    /// A family with its tasks counted.
    pub fn new(family: &'static Family, tasks: &[Task]) -> FamilyOut {
        FamilyOut {
            name: family.name,
            about: family.about,
            gymnasium: family.gymnasium,
            tasks: tasks.len(),
            split: split_counts(tasks),
            action_space: tasks.first().map(|t| ActionSpaceOut::from(t.actions())),
        }
    }
}

/// How many tasks are in each part.
fn split_counts(tasks: &[Task]) -> SplitCounts {
    let count = |split: Split| tasks.iter().filter(|t| t.split == split).count();
    SplitCounts { train: count(Split::Train), validation: count(Split::Validation), test: count(Split::Test) }
}

impl FamilyTasks {
    /// Some of a family's tasks, the first of all of them, and the cursor of those after these.
    pub fn new<'a>(
        family: &'static Family,
        first: &Task,
        tasks: impl Iterator<Item = &'a Task>,
        next: Option<String>,
    ) -> FamilyTasks {
        let names = observation::names(&first.scene);
        let row = |t: &Task| TaskRow {
            id: t.id.clone(),
            split: t.split.into(),
            certificate: t.certificate.as_ref().map(Certificate::from),
        };
        FamilyTasks {
            name: family.name,
            tasks: tasks.map(row).collect(),
            next,
            action_space: ActionSpaceOut::from(first.actions()),
            observation_space: ObservationSpaceOut {
                low: vec![0.0; names.len()],
                high: vec![1.0; names.len()],
                names,
            },
        }
    }
}

impl From<Task> for TaskOut {
    fn from(t: Task) -> TaskOut {
        TaskOut {
            id: t.id,
            split: t.split.into(),
            scene: t.scene,
            certificate: t.certificate.as_ref().map(Certificate::from),
        }
    }
}

impl From<&task::Certificate> for Certificate {
    fn from(c: &task::Certificate) -> Certificate {
        Certificate {
            action: c.action.clone(),
            seed: c.seed,
            solving_share: c.solving_share,
            solving_share_undamped: c.solving_share_undamped,
        }
    }
}

impl Bulk for Families {}
impl Bulk for FamilyTasks {}
impl Bulk for TaskOut {}
