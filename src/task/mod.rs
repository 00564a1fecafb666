//! What is asked: scenes, what may be placed in them, goals, and the registry of task families.
//!
//! A family is one file in `families/` and one row in [`families`], a shape one file and one row in [`shape`]. Nothing
//! here moves.

pub mod action;
pub mod ball;
mod body;
mod contact_rules;
mod custom;
mod families;
pub mod geometry;
mod goal;
mod intervention;
mod limits;
pub mod phyre;
mod placement;
pub mod scene;
mod setting;
pub mod shape;
pub mod solid;
pub mod timeline;
mod validate;

use serde::{Deserialize, Serialize};

pub use action::{ActionSpace, ValidAction};
pub use custom::custom;
pub use families::{
    Ahead, Bin, CANDIDATE_SEED, CERTIFIED_FORMAT, COLLECTIONS, Certificate, Certified, CertifiedRow, Claims,
    Collection, DEFAULT_FAMILY, Draws, FAMILY_FORMAT, Family, Labels, Learning, Nearer, RealPhysics,
    Selection, certified_beside, collection, families, family, parse_family, parse_family_beside,
    read_families, read_family, take_in,
};
pub use intervention::Intervention;
pub use placement::Placement;
pub use scene::Scene;

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

/// The tasks of one split.
pub fn split(tasks: &[Task], split: Split) -> Vec<Task> {
    tasks.iter().filter(|t| t.split == split).cloned().collect()
}
