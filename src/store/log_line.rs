//! Buffered lines of job logs.

use crate::names::names;

/// A line that is not written yet.
pub struct PendingLogLine {
    pub job: i64,
    pub at: u64,
    pub level: LogLevel,
    pub text: String,
}

/// Severity of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogLevel {
    Info,
    Warning,
    Error,
}

names!(LogLevel: Info = "info", Warning = "warning", Error = "error");
