//! Request and response bodies that are not core types, as plain structs.
//!
//! Requests reject unknown fields and convert into core types with errors that name the field; responses convert from core
//! types by `From`.

mod adhoc;
mod array;
mod ask_tell;
mod batch;
mod binary_arrays;
pub mod bounds;
mod branch;
mod control;
mod diagnosis;
mod episode;
mod format;
mod health;
mod history;
mod intervention;
mod job;
mod likelihood;
mod log;
pub mod msgpack;
mod physics;
mod policy;
mod rollout;
mod space;
mod surface;
mod task;
mod token;
mod watch;
mod world;

pub use adhoc::{ContactOut, PlaceIn, PlacementsOut, SimulateIn, SimulationOut};
pub use array::{Array, ArrayData, to_nested_lists};
pub use ask_tell::{
    ProposalOut, Proposals, SubmissionQuery, SubmissionStatus, TrialIn, TrialOut, TrialsPage,
    TrialsSubmission,
};
pub use batch::{
    CreateWorlds, CreatedWorlds, ResetWorlds, ResetWorldsOut, StepWorlds, StepWorldsOut, WorldIds,
};
pub use binary_arrays::BinaryArrays;
pub use branch::{BranchIn, BranchOut, SnapshotIn, SnapshotOut};
pub use control::{
    ControlResetIn, ControlResetOut, ControlRolloutIn, ControlRolloutOut, ControlStepIn, ControlStepOut,
    ControlTaskOut, ControlTasksOut, ControlWorldOut, CreateControlWorld, PhysicsIn,
};
pub use diagnosis::{DiagnosisTrialOut, DiagnosisTrials};
pub use episode::{ResetOut, StepIn, StepOut};
pub use format::{MSGPACK, WireFormat};
pub use health::Health;
pub use history::{EstimationHistory, RoundOut};
pub use job::{JobOut, JobPatch, JobsPage};
pub use likelihood::{ChainStarts, ChainStartsIn, LikelihoodIn, LogDensities, PointsIn};
pub use log::{JobLogPage, LogLineOut};
pub use policy::{ActIn, EvaluateIn, LearnIn, PoliciesPage, ProposedActions, RankingIn, ScoredAction};
pub use rollout::{BodyTrack, RolloutIn, RolloutOut};
pub use surface::{SensitivityOut, SurfaceOut, SurfaceWithPoints, SurfacesPage};
pub use task::{FamiliesPage, FamilyOut, FamilyTasksPage, TaskOut, TaskSummary};
pub use token::{CreatedToken, TokenIn, TokenOut, TokensPage};
pub use watch::{WatchStart, WorldEventOut, drawable_scene};
pub use world::{CreateWorld, WorldOut, WorldsPage};
