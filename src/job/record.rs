//! A job as its owner sees it.

use serde::Serialize;
use utoipa::ToSchema;

use crate::error::{Error, Result};
use crate::store::JobRow;

/// A job with the id of its last event.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Unique, restarts included.
    pub id: String,
    /// Its stored row.
    pub row: JobRow,
    /// Estimated remaining time, s, if known.
    pub left: Option<f64>,
    /// In an event: figures reported since the previous event.
    pub figures: Vec<Figure>,
}

/// A metric reported during a job.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[schema(as = FigureOut)]
pub struct Figure {
    pub name: &'static str,
    /// Completed units of the stage.
    pub at: u64,
    pub value: f64,
}

/// Outcome of deleting a job.
#[derive(Clone, Debug, PartialEq)]
pub enum DeleteOutcome {
    /// It was cancelled: it is stopping, or will not start.
    Cancelled(Box<Job>),
    /// It had ended and was removed.
    Removed,
}

impl Job {
    /// From its row, without an estimate of the remaining time.
    pub(super) fn of(row: JobRow) -> Job {
        Job { id: id(row.number), row, left: None, figures: Vec::new() }
    }
}

/// The id of the job with this number.
pub fn id(number: i64) -> String {
    format!("job-{number}")
}

/// The number of the job with this id.
pub(super) fn number(id: &str) -> Result<i64> {
    let number = id.strip_prefix("job-").and_then(|n| n.parse().ok());
    number.filter(|n| self::id(*n) == id).ok_or_else(|| unknown(id))
}

/// The error of an unknown job.
pub(super) fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "job", id: id.to_string(), known: Vec::new() }
}
