//! Families and tasks.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use super::space::{ActionSpaceOut, ObservationSpaceOut};
use crate::error::{Error, Result};
use crate::session::TaskSet;
use crate::task::{self, Family, Scene, Split, Task};

/// All families.
#[derive(Serialize, ToSchema)]
pub struct FamiliesPage {
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
    /// Id of the Gymnasium environment.
    pub gymnasium: &'static str,
    /// Number of tasks.
    pub tasks: usize,
    pub split: SplitCounts,
    pub action_space: Option<ActionSpaceOut>,
}

/// Number of tasks per split.
#[derive(Serialize, ToSchema)]
pub struct SplitCounts {
    pub train: usize,
    pub validation: usize,
    pub test: usize,
}

/// The tasks of a family.
#[derive(Serialize, ToSchema)]
pub struct FamilyTasksPage {
    pub name: &'static str,
    pub tasks: Vec<TaskSummary>,
    pub action_space: ActionSpaceOut,
    pub observation_space: ObservationSpaceOut,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// A task without its scene.
#[derive(Serialize, Deserialize, ToSchema)]
pub struct TaskSummary {
    pub id: String,
    pub split: Split,
    pub certificate: Option<CertificateOut>,
}

/// A task with its scene.
#[derive(Serialize, Deserialize, ToSchema)]
pub struct TaskOut {
    pub id: String,
    pub split: Split,
    /// An `iplw.scene/1` document.
    #[schema(value_type = Object)]
    pub scene: Scene,
    pub certificate: Option<CertificateOut>,
}

/// Evidence that a task can be solved.
#[derive(Serialize, Deserialize, ToSchema)]
pub struct CertificateOut {
    /// An action that solves the task, also when perturbed.
    pub action: Vec<f64>,
    /// Seed of the search.
    pub seed: u64,
    /// Fraction of valid actions that solve it in the family's real world.
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

/// Counts the tasks of each split.
fn split_counts(tasks: &[Task]) -> SplitCounts {
    let count = |split: Split| tasks.iter().filter(|t| t.split == split).count();
    SplitCounts { train: count(Split::Train), validation: count(Split::Validation), test: count(Split::Test) }
}

impl FamilyTasksPage {
    /// A page of a family's tasks; `next`: cursor of the next page.
    pub fn new<'a>(
        set: &TaskSet,
        tasks: impl Iterator<Item = &'a Task>,
        next: Option<String>,
    ) -> Result<FamilyTasksPage> {
        let family = set.family.ok_or_else(|| Error::Failed("a family disappeared".into()))?;
        let names = set.feature_names();
        let row = |t: &Task| TaskSummary {
            id: t.id.clone(),
            split: t.split,
            certificate: t.certificate.as_ref().map(CertificateOut::from),
        };
        Ok(FamilyTasksPage {
            name: family.name,
            tasks: tasks.map(row).collect(),
            next,
            action_space: ActionSpaceOut::from(set.tasks[0].actions()),
            observation_space: ObservationSpaceOut {
                low: vec![0.0; names.len()],
                high: vec![1.0; names.len()],
                names,
            },
        })
    }
}

impl From<Task> for TaskOut {
    fn from(t: Task) -> TaskOut {
        TaskOut {
            id: t.id,
            split: t.split,
            scene: t.scene,
            certificate: t.certificate.as_ref().map(CertificateOut::from),
        }
    }
}

impl From<&task::Certificate> for CertificateOut {
    fn from(c: &task::Certificate) -> CertificateOut {
        CertificateOut {
            action: c.action.clone(),
            seed: c.seed,
            solving_share: c.solving_share,
            solving_share_undamped: c.solving_share_undamped,
        }
    }
}

impl BinaryArrays for FamiliesPage {}
impl BinaryArrays for FamilyTasksPage {}
impl BinaryArrays for TaskOut {}
