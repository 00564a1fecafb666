//! What happened to a job, line by line.

use serde::Serialize;
use utoipa::ToSchema;

use super::bulk::Bulk;
use crate::store::LogRow;

/// Lines of a job's log.
#[derive(Serialize, ToSchema)]
pub struct Log {
    /// In the order of happening.
    pub lines: Vec<LineOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// One line of a job's log.
#[derive(Serialize, ToSchema)]
pub struct LineOut {
    /// From 1; gaps are lines that are no longer kept.
    pub number: u64,
    /// s since 1970, to the ms.
    pub at: f64,
    /// `info`, `warning` or `error`.
    pub level: &'static str,
    pub text: String,
}

impl From<LogRow> for LineOut {
    fn from(row: LogRow) -> LineOut {
        LineOut { number: row.number, at: row.at as f64 / 1e3, level: row.level.name(), text: row.text }
    }
}

impl Bulk for Log {}
