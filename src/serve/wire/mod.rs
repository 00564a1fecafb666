//! What stands on the wire: JSON bodies in and out, as plain structs apart from the core's.
//!
//! Requests refuse unknown fields and turn into core types by conversions that name what is wrong; answers are
//! made from core types by `From`.

mod action;
mod array;
mod asked;
mod batch;
pub mod bounds;
mod branch;
mod bulk;
mod course;
mod design;
mod diagnosis;
mod episode;
mod form;
mod health;
mod intervention;
mod job;
mod likelihood;
mod log;
pub mod pack;
mod physics;
mod plan;
mod policy;
mod posterior;
mod rollout;
mod sketch;
mod space;
mod strict;
mod surface;
mod task;
mod token;
mod watched;
mod world;

pub use array::{Array, Data, lists};
pub use asked::{ProposalOut, Proposals, TellIn, TellQuery, Told, TrialIn, TrialOut, Trials};
pub use batch::{CreateWorlds, ResetWorlds, StepWorlds, WorldIds, WorldsMade, WorldsReset, WorldsStepped};
pub use branch::{BranchIn, BranchOut, SnapshotIn, SnapshotOut};
pub use bulk::Bulk;
pub use course::{Course, RoundOut};
pub use design::DesignIn;
pub use diagnosis::{DiagnosisIn, GivenOut, GivenTrials};
pub use episode::{ResetIn, ResetOut, SplitIn, StepIn, StepOut};
pub use form::{Form, MSGPACK};
pub use health::Health;
pub use job::{Estimation, JobOut, Jobs, RealChoice, RealIn};
pub use likelihood::{Densities, LikelihoodIn, PointsIn, Starts, StartsIn};
pub use log::{LineOut, Log};
pub use physics::{LatentsIn, effects};
pub use plan::{Believing, PlanIn};
pub use policy::{
    ActIn, Acted, EvaluateIn, LearnIn, Policies, PolicyOut, RankingIn, Scored, TrainIn, TrainPresetIn,
    TrainingIn,
};
pub use posterior::PosteriorIn;
pub use rollout::{BatchOut, RolloutIn};
pub use sketch::{PlaceIn, Places, SimulateIn, Simulated};
pub use strict::Object;
pub use surface::{SensitivityOut, SurfaceIn, SurfaceOut, SurfaceWhole, Surfaces};
pub use task::{Families, FamilyOut, FamilyTasks, TaskOut};
pub use token::{TokenIn, TokenMade, TokenOut, Tokens};
pub use watched::{HappenedOut, WatchOut, drawn};
pub use world::{CreateWorld, WorldOut, Worlds};
