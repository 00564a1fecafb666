//! A job as its owner sees it.

use crate::error::{Error, Result};
use crate::store::JobRow;

/// A job with the id of its last event.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Unique, restarts included.
    pub id: String,
    /// What is known of it.
    pub row: JobRow,
    /// How long it will still take, s, as far as that can be told.
    pub left: Option<f64>,
    /// At an event: what its work told since the event before.
    pub figures: Vec<Figure>,
}

/// A figure that work told on its way: `name` was `value` when `at` units of the stage were done.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    pub name: &'static str,
    pub at: u64,
    pub value: f64,
}

/// What deleting a job did.
#[derive(Clone, Debug, PartialEq)]
pub enum Deleted {
    /// It is told to stop (or will not start).
    Cancelled(Box<Job>),
    /// It had ended and is forgotten.
    Forgotten,
}

impl Job {
    /// What is known of it, and nothing of its pace.
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

/// There is no such job.
pub(super) fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "job", id: id.to_string(), known: Vec::new() }
}
