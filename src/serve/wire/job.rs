//! Jobs and their events; the request of an estimation.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::{EffectIn, LatentsIn, Object};
use crate::job::Job;
use crate::serve::problem::Problem;

/// An estimation to run. The real world is `world` (its interactions are counted there) or one made for this
/// job from `real`; without either, the family's standard one.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Estimation {
    /// A family (`bowling`: its training tasks are explored) or one task.
    pub task: String,
    /// Id of a real world of that family.
    pub world: Option<String>,
    /// A real world for this job alone.
    #[schema(value_type = Option<RealIn>)]
    pub real: Option<Object<RealIn>>,
    /// `collisions`, `rolling`, `random` or `mixed` (the default).
    pub strategy: Option<String>,
    /// Most rounds of exploring, measuring and fitting; default 5.
    pub rounds: Option<u64>,
    /// Real interactions a round; default 10.
    pub actions: Option<u64>,
    /// Latent samples per iteration of the search.
    pub samples: Option<u64>,
    pub seed: Option<u64>,
    /// Most real interactions in all.
    pub budget: Option<u64>,
}

/// A real world, where it differs from the family's standard one.
#[derive(Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RealIn {
    /// Kept share of velocity per second, in (0, 1].
    pub damping: Option<f64>,
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<Object<LatentsIn>>,
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<Object<EffectIn>>>,
    /// Standard deviation of observation noise, m.
    pub noise: Option<f64>,
}

/// Long work.
#[derive(Serialize, ToSchema)]
pub struct JobOut {
    pub id: String,
    /// `iplw`, `train` or `evaluate`.
    pub kind: String,
    /// `queued`, `running`, `succeeded`, `failed` or `cancelled`.
    pub state: &'static str,
    pub progress: ProgressOut,
    /// What was asked for.
    #[schema(value_type = Object)]
    pub config: Value,
    /// When succeeded.
    #[schema(value_type = Option<Object>)]
    pub result: Option<Value>,
    /// When failed: why.
    #[schema(value_type = Option<Problem>)]
    pub error: Option<Value>,
    pub seed: u64,
    /// Version of the program that ran it.
    pub version: String,
}

/// How far a job is.
#[derive(Serialize, ToSchema)]
pub struct ProgressOut {
    pub stage: String,
    pub done: u64,
    pub total: u64,
}

/// All jobs.
#[derive(Serialize, ToSchema)]
pub struct Jobs {
    pub jobs: Vec<JobOut>,
}

/// One server-sent event: `done` for a job that has ended, else `progress`.
pub struct Event {
    pub id: u64,
    pub name: &'static str,
    pub data: JobOut,
}

impl From<Job> for JobOut {
    fn from(job: Job) -> JobOut {
        let row = job.row;
        JobOut {
            id: job.id,
            kind: row.kind,
            state: row.state.name(),
            progress: ProgressOut { stage: row.stage, done: row.done, total: row.total },
            config: row.config,
            result: row.result,
            error: row.error,
            seed: row.seed,
            version: row.version,
        }
    }
}

impl Event {
    /// Event `id` of a job.
    pub fn new(id: u64, job: Job) -> Event {
        let name = if job.row.state.ended() { "done" } else { "progress" };
        Event { id, name, data: job.into() }
    }
}
