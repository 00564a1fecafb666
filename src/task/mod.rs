//! Tasks: scenes, actions, goals, and the registry of task families. Plain data, no dynamics.
//!
//! A family is one file in `families/` and one row in [`families`]; a shape is one file and one row in
//! [`shape`].

pub mod action;
pub mod ball;
pub(crate) mod body;
pub mod complexity;
pub mod constants;
mod contact_rules;
pub mod control;
mod custom;
mod effect_term;
pub(crate) mod expression;
mod families;
pub mod geometry;
mod goal;
mod intervention;
pub mod joint;
pub(crate) mod limits;
pub mod phyre;
mod placement;
mod robot_file;
pub mod scene;
mod setting;
pub mod shape;
pub mod solid;
pub mod timeline;
mod validate;
mod validate_joints;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::names::names;
pub use action::{ActionSpace, ValidAction};
pub use custom::{custom, explorable};
pub(crate) use families::HiddenPhysics;
pub use families::{
    CANDIDATE_SEED, CERTIFIED_FORMAT, COLLECTIONS, CandidateDraws, Certificate, CertifiedRow, CertifiedTasks,
    Claims, Collection, DEFAULT_FAMILY, DEFAULT_PRIOR, EstimateClaim, FAMILY_FORMAT, Family, JumpStartClaim,
    LabelCounts, Learning, RealPhysics, Selection, SolvingShareBin, certified_beside, collection, families,
    family, parse_family, parse_family_beside, read_families, read_family, register_families, unknown_family,
};
pub use intervention::Intervention;
pub use placement::Placement;
pub use robot_file::{ImportedMechanism, mechanism_from_xml};
pub use scene::Scene;

/// A single-action task: a scene with an action space and a goal.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// `family:number`, or a custom scene's name.
    pub id: String,
    /// Name of the family; `custom` for a user's scene.
    pub family: String,
    /// The split to which it belongs.
    pub split: Split,
    /// The scene without an action; always has an action space.
    pub scene: Scene,
    /// A verified solution; absent for custom tasks.
    pub certificate: Option<Certificate>,
}

/// Split of a family's tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
#[schema(as = SplitIn)]
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

    /// Applies an action to the task's scene.
    pub fn place(&self, action: &ValidAction) -> Placement {
        self.actions().place(&self.scene, action)
    }
}

names!(Split: Train = "train", Validation = "validation", Test = "test");

/// The tasks of one split.
pub fn split(tasks: &[Task], split: Split) -> Vec<Task> {
    tasks.iter().filter(|t| t.split == split).cloned().collect()
}
