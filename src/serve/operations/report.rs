//! The report of a job's result as a page.

use super::surface::stored;
use crate::error::{Error, Result};
use crate::report::{JobResult, job_report};
use crate::serve::operation::{MediaBody, Operation, PathId, READ, get};
use crate::serve::request_context::RequestContext;

/// Operations on reports.
pub fn operations() -> Vec<Operation> {
    vec![
        get("get_report", "/v1/jobs/{id}/report", "jobs", READ)
            .about(
                "Returns the report of a job's result as one HTML page without scripts or external resources: the result in a sentence, \
                 pictures,\ntables and settings. The command line writes the same page as report.html.",
            )
            .media_response(200, "The page", &["text/html"])
            .errors(&[(404, ""), (409, "The job has no result, or one of another version")])
            .compute_handler(report),
    ]
}

fn report(app: &RequestContext, PathId(id): PathId) -> Result<MediaBody> {
    let job = app.jobs().get(&id)?.row;
    let Some(result) = &job.result else {
        let reason = format!("{id} is {}: reports are of jobs that have succeeded", job.state.name());
        return Err(Error::Refused { reason });
    };
    let task = match job.config["task"].as_str() {
        Some(id) if job.kind == "plan" => app.catalogue.task(id).ok(),
        _ => None,
    };
    let surface = result["surface"].as_str().map(|id| stored(app.store(), id)).transpose()?;
    let all = JobResult {
        kind: &job.kind,
        summary: job.metadata.summary.as_deref(),
        config: &job.config,
        result,
        version: &job.version,
        task: task.as_ref(),
        surface: surface.as_ref(),
    };
    Ok(MediaBody { kind: "text/html; charset=utf-8", bytes: job_report(&all)?.to_html().into_bytes() })
}
