//! What stands on the wire: JSON bodies in and out, as plain structs apart from the core's.
//!
//! Requests refuse unknown fields and turn into core types by conversions that name what is wrong; answers are
//! made from core types by `From`.

mod array;
mod asked;
mod batch;
mod diagnosis;
mod job;
pub mod pack;
mod packed;
mod policy;
mod strict;
mod surface;
mod task;
mod world;

pub use array::{Array, Data, lists};
pub use asked::{ProposalOut, Proposals, TellIn, TellQuery, Told, TrialIn, TrialOut, Trials};
pub use batch::{CreateWorlds, ResetWorlds, StepWorlds, WorldIds, WorldsMade, WorldsReset, WorldsStepped};
pub use diagnosis::DiagnosisIn;
pub use job::{Estimation, Event, JobOut, Jobs, RealChoice, RealIn};
pub use packed::packed;
pub use policy::{
    ActIn, Acted, EvaluateIn, LearnIn, Policies, PolicyOut, RankingIn, Scored, TrainIn, TrainingIn,
};
pub use strict::Object;
pub use surface::{SensitivityOut, SurfaceIn, SurfaceOut, SurfaceWhole, Surfaces};
pub use task::{Families, FamilyOut, FamilyTasks, TaskOut};
pub use world::{
    ActionIn, ActionSpaceOut, BatchOut, CreateWorld, EffectIn, LatentsIn, ObservationSpaceOut, ResetIn,
    ResetOut, RolloutIn, SplitIn, StepIn, StepOut, WorldOut, Worlds, effects,
};

use serde::Serialize;
use utoipa::ToSchema;

/// An answer that may hold numbers in bulk.
pub trait Bulk {
    /// Takes them out, by the name of their field, for a client that wants them as pieces of memory.
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        Vec::new()
    }
}

/// Answers of plain values only.
macro_rules! without_bulk {
    ($($answer:ty),*) => { $(impl Bulk for $answer {})* };
}
without_bulk!(
    Acted,
    Families,
    FamilyTasks,
    Health,
    JobOut,
    Jobs,
    Policies,
    PolicyOut,
    Proposals,
    TaskOut,
    Told,
    Trials,
    SurfaceWhole,
    Surfaces,
    WorldOut,
    Worlds,
    WorldsMade,
    crate::task::Scene
);

/// Whether the server answers.
#[derive(Serialize, ToSchema)]
pub struct Health {
    /// `ok`, `ready` or `stopping`.
    pub status: &'static str,
    /// Version of the program.
    pub version: &'static str,
}
