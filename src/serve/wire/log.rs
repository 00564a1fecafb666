//! Log of a job.

use serde::Serialize;
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use crate::store::LogRow;

/// Lines of a job's log.
#[derive(Serialize, ToSchema)]
pub struct JobLogPage {
    /// In chronological order.
    pub lines: Vec<LogLineOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// One line of a job's log.
#[derive(Serialize, ToSchema)]
pub struct LogLineOut {
    /// From 1; missing numbers are lines that were dropped.
    pub number: u64,
    /// Unix time, s, with ms precision.
    pub at: f64,
    /// `info`, `warning` or `error`.
    pub level: &'static str,
    pub text: String,
}

impl From<LogRow> for LogLineOut {
    fn from(row: LogRow) -> LogLineOut {
        LogLineOut { number: row.number, at: row.at as f64 / 1e3, level: row.level.name(), text: row.text }
    }
}

impl BinaryArrays for JobLogPage {}
