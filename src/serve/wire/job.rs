//! Jobs and their events.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use crate::error::{Error, Result};
use crate::job::{Figure, Job};
use crate::serve::problem::Problem;

/// An asynchronous job.
#[derive(Serialize, ToSchema)]
pub struct JobOut {
    pub id: String,
    /// `iplw`, `diagnose`, `posterior`, `likelihood`, `plan`, `design`, `surface`, `train`, `learn` or `evaluate`.
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
    /// Name of its owner's choice; empty if it has none.
    pub name: String,
    /// Note of its owner; empty if there is none.
    pub note: String,
    /// Name of the token that queued it; `null` without a token.
    pub owner: Option<String>,
    /// Time of the request, UNIX seconds; `null` if unknown, for jobs of earlier versions.
    pub created: Option<f64>,
    /// Time of its first start, UNIX seconds; `null` if it has not run.
    pub started: Option<f64>,
    /// Time of its end, UNIX seconds; `null` if it has not ended.
    pub ended: Option<f64>,
    /// The result in a phrase, also where the result is omitted; `null` if there is none.
    pub summary: Option<String>,
}

/// Maximum length of a job's name, characters.
const MAX_NAME_CHARS: usize = 200;
/// Maximum length of a job's note, characters.
const MAX_NOTE_CHARS: usize = 10_000;

/// Changes of a job; absent fields stay as they are.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JobPatch {
    /// One line without control characters; empty for none.
    #[schema(max_length = 200)]
    pub name: Option<String>,
    /// Any number of lines; empty for none.
    #[schema(max_length = 10000)]
    pub note: Option<String>,
}

impl JobPatch {
    /// Errors unless the texts are short enough and contain no control characters.
    pub fn check(&self) -> Result<()> {
        let line_break = |c: char| matches!(c, '\n' | '\r' | '\t');
        check_text("name", self.name.as_deref(), MAX_NAME_CHARS, "a line", |_| false)?;
        check_text("note", self.note.as_deref(), MAX_NOTE_CHARS, "a text", line_break)
    }
}

fn check_text(
    field: &str,
    text: Option<&str>,
    max_chars: usize,
    form: &str,
    allows: fn(char) -> bool,
) -> Result<()> {
    let text = text.unwrap_or_default();
    let count = text.chars().count();
    let allowed = format!("{form} of at most {max_chars} characters, without control characters");
    if count > max_chars {
        return Err(Error::input(field, format!("{count} characters"), allowed));
    }
    match text.chars().find(|c| c.is_control() && !allows(*c)) {
        Some(control) => Err(Error::input(field, format!("a text with {control:?}"), allowed)),
        None => Ok(()),
    }
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
        let seconds = |ms: Option<u64>| ms.map(|ms| ms as f64 / 1000.0);
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
            name: row.metadata.name,
            note: row.metadata.note,
            owner: row.owner,
            created: seconds(row.metadata.created),
            started: seconds(row.metadata.started),
            ended: seconds(row.metadata.ended),
            summary: row.metadata.summary,
        }
    }
}

impl BinaryArrays for JobOut {}
impl BinaryArrays for JobsPage {}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(name: Option<&str>, note: Option<&str>) -> Option<String> {
        let patch = JobPatch { name: name.map(String::from), note: note.map(String::from) };
        patch.check().err().map(|e| e.to_string())
    }

    #[test]
    fn texts_are_limited_in_characters() {
        let (name, note) = ("é".repeat(MAX_NAME_CHARS), "é\n".repeat(MAX_NOTE_CHARS / 2));
        assert_eq!(refusal(Some(&name), Some(&note)), None);
        assert_eq!(refusal(Some(""), Some("")), None);
        assert_eq!(refusal(None, None), None);
        let longer = refusal(Some(&format!("{name}a")), None).unwrap();
        assert!(longer.contains("name") && longer.contains("201") && longer.contains("200"), "{longer}");
        assert!(refusal(None, Some(&format!("{note}a"))).unwrap().contains("10001"));
    }

    #[test]
    fn document_has_the_limits() {
        let schema = serde_json::to_value(<JobPatch as utoipa::PartialSchema>::schema()).unwrap();
        let limit = |field: &str| schema["properties"][field]["maxLength"].clone();
        assert_eq!((limit("name"), limit("note")), (MAX_NAME_CHARS.into(), MAX_NOTE_CHARS.into()));
    }

    #[test]
    fn rejects_control_characters() {
        for name in ["two\nlines", "\u{1b}[31m", "\0", "tab\t"] {
            assert!(refusal(Some(name), None).unwrap().contains("control"), "{name:?}");
        }
        assert_eq!(refusal(None, Some("a\r\n\tb")), None);
        assert!(refusal(None, Some("\u{9b}31m")).is_some());
    }
}
