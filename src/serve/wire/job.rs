//! Jobs and their events.

use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use crate::job::{Figure, Job};
use crate::serve::problem::Problem;

/// An asynchronous job.
#[derive(Serialize, ToSchema)]
pub struct JobOut {
    pub id: String,
    /// `iplw`, `diagnose`, `surface`, `train`, `learn` or `evaluate`.
    pub kind: String,
    /// `queued`, `running`, `waiting` (for submitted trials), `succeeded`, `failed` or `cancelled`.
    pub state: &'static str,
    pub progress: ProgressOut,
    /// The request, without large data.
    #[schema(value_type = Object)]
    pub config: Value,
    /// Result, if succeeded.
    #[schema(value_type = Option<Object>)]
    pub result: Option<Value>,
    /// Error, if failed.
    #[schema(value_type = Option<Problem>)]
    pub error: Option<Value>,
    pub seed: u64,
    /// Version of the program that ran it.
    pub version: String,
}

/// Progress of a job.
#[derive(Serialize, ToSchema)]
pub struct ProgressOut {
    pub stage: String,
    pub done: u64,
    pub total: u64,
    /// Estimated remaining seconds: of all rounds for an estimation (after the first), otherwise of the stage; `null` while
    /// unknown.
    pub eta_s: Option<f64>,
    /// In events: metrics since the previous event. `loss`: mean binary cross-entropy of the batches since then, nats;
    /// `validation`: AUCCESS on validation tasks.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub figures: Vec<Figure>,
}

/// All jobs.
#[derive(Serialize, ToSchema)]
pub struct JobsPage {
    pub jobs: Vec<JobOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

impl From<Job> for JobOut {
    fn from(job: Job) -> JobOut {
        let row = job.row;
        JobOut {
            id: job.id,
            kind: row.kind,
            state: row.state.name(),
            progress: ProgressOut {
                stage: row.stage,
                done: row.done,
                total: row.total,
                eta_s: job.left,
                figures: job.figures,
            },
            config: row.config,
            result: row.result,
            error: row.error,
            seed: row.seed,
            version: row.version,
        }
    }
}

impl BinaryArrays for JobOut {}
impl BinaryArrays for JobsPage {}
