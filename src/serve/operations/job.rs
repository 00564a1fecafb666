//! Jobs of all kinds as resources.

use std::sync::Arc;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::json::to_value;
use crate::access::Principal;
use crate::error::{Error, Result};
use crate::job::{DeleteOutcome, Job, JobContext, JobSpec, Watcher, Work, WorkOutcome};
use crate::json::from_value;
use crate::serve::concealment::conceal_job;
use crate::serve::operation::{
    ACT, EventStream, Extractor, HandlerOutput, JsonBody, LastEventId, NextEvent, Operation, OperationDoc,
    OperationRequest, OperationResponse, Pagination, PathId, Payload, READ, RecordResponse, ServerEvent,
    delete, get, patch,
};
use crate::serve::problem::HandlerResult;
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::{JobLogPage, JobOut, JobPatch, JobsPage, LogLineOut};
use crate::store::{JobList, JobState};

/// Operations on jobs.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_jobs", "/v1/jobs", "jobs", READ)
            .about(
                "Lists jobs, by default oldest first.\n\nResults can be large, especially of diagnoses; omit them with \
                 `results=false` when polling.",
            )
            .links(200, "/v1/jobs/{id}", "/jobs/0/id")
            .handler(list),
        get("get_job", "/v1/jobs/{id}", "jobs", READ)
            .about("Returns a job.")
            .errors(&[(404, "")])
            .handler(|app, PathId(id)| Ok(JobOut::from(app.jobs().get(&id)?))),
        patch("update_job", "/v1/jobs/{id}", "jobs", ACT)
            .about("Sets the name and the note of a job, in any state; fields that are absent stay as they are.")
            .errors(&[(404, ""), (429, "Too many bytes are stored for the token")])
            .handler(update),
        delete("delete_job", "/v1/jobs/{id}", "jobs", ACT)
            .about("Cancels a job that has not ended (202), or deletes one that has (204).")
            .response::<JobOut>(202, "Cancellation requested")
            .empty_response(204, "Deleted")
            .errors(&[(404, "")])
            .handler(remove),
        get("get_job_log", "/v1/jobs/{id}/log", "jobs", READ)
            .about(
                "Returns a job's log: stages, rounds, warnings, server restarts and its end.\n\nThe latest 1000 lines are kept as \
                 long as the job. To follow the log, repeat the request with `after`.",
            )
            .errors(&[(404, "")])
            .handler(log),
        get("follow_job", "/v1/jobs/{id}/events", "jobs", READ)
            .about(
                "Streams a job's progress as server-sent events: `progress`, and `done` at the end, each with the job as data. \
                 With\n`Last-Event-ID`, only later events; 204 if there will be none.",
            )
            .media_response(200, "Events", &["text/event-stream"])
            .empty_response(204, "The job has ended and its last event was received")
            .errors(&[(404, ""), (422, "")])
            .http_only()
            .handler(events),
    ]
}

/// Queues a job with its fully specified `plan`; `config` is the request without large data.
pub fn submit(
    app: &RequestContext,
    kind: &'static str,
    config: &Value,
    plan: &impl Serialize,
    seed: u64,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let new = JobSpec { kind, config, plan: &to_value(plan)?, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// Work that computes a result from its plan. After a restart it starts over and gives the same result.
pub fn restartable<P: DeserializeOwned + Send + 'static>(
    base: &Arc<CoreState>,
    plan: &Value,
    run: fn(&CoreState, &JobContext, &P) -> Result<Value>,
) -> Result<Work> {
    let (base, plan): (_, P) = (base.clone(), from_value(plan.clone())?);
    Ok(Box::new(move |context| run(&base, context, &plan).map(WorkOutcome::Done)))
}

/// Query parameters of a list of jobs.
struct JobsQuery(JobList, Pagination);

impl Extractor for JobsQuery {
    fn describe(to: &mut OperationDoc) {
        to.query::<String>("order", "`oldest` (default) or `newest` first");
        to.query::<String>("state", "Only jobs in this state");
        to.query::<String>("kind", "Only jobs of this kind: `train`, `evaluate`, ...");
        to.query::<bool>("results", "Whether to include results, which can be large. Default: `true`");
        Pagination::describe(to);
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<JobsQuery> {
        let mut query = from.query()?;
        let mut taken = |name: &str| {
            let at = query.iter().position(|(n, _)| n == name);
            at.map(|i| query.remove(i).1)
        };
        let newest = match taken("order").as_deref() {
            None | Some("oldest") => false,
            Some("newest") => true,
            Some(other) => {
                return Err(Error::input("order", format!("{other:?}"), "oldest or newest").into());
            }
        };
        let state = match taken("state") {
            None => None,
            Some(name) => Some(JobState::named(&name).ok_or_else(|| {
                let all = JobState::ALL.map(JobState::name).join(", ");
                Error::input("state", format!("{name:?}"), format!("one of {all}"))
            })?),
        };
        let bare = match taken("results").as_deref() {
            None | Some("true") => false,
            Some("false") => true,
            Some(other) => {
                return Err(Error::input("results", format!("{other:?}"), "true or false").into());
            }
        };
        let kind = taken("kind");
        Ok(JobsQuery(JobList { newest, state, kind, bare }, Pagination::from_query(&query)?))
    }
}

fn list(app: &RequestContext, JobsQuery(list, page): JobsQuery) -> Result<JobsPage> {
    let kinds = app.jobs().kinds();
    if let Some(unknown) = list.kind.as_ref().filter(|k| !kinds.contains(&k.as_str())) {
        return Err(Error::input("kind", format!("{unknown:?}"), format!("one of {}", kinds.join(", "))));
    }
    // A cursor is only valid for the list it came from.
    let name = if list.newest { "jobs-newest" } else { "jobs" };
    let (mut all, count) = list_within_bytes(app, &list, page.after(name)?, page.fetch_limit())?;
    let next = page.truncate_to(count, name, &mut all, |j| j.row.number);
    Ok(JobsPage { jobs: all.into_iter().map(JobOut::from).collect(), next })
}

/// Jobs read from the store at a time.
const JOBS_READ_AT_ONCE: usize = 8;
/// A page ends with the job that takes it above this size, bytes as JSON.
const MAX_PAGE_BYTES: usize = 16 << 20;

/// At most `limit` jobs, fewer if they are large; and how many of them a page holds, so that one more follows if there are more.
fn list_within_bytes(
    app: &RequestContext,
    list: &JobList,
    mut after: Option<i64>,
    limit: usize,
) -> Result<(Vec<Job>, usize)> {
    let (mut all, mut bytes) = (Vec::new(), 0);
    while all.len() < limit && (all.len() < 2 || bytes <= MAX_PAGE_BYTES) {
        let part = app.jobs().list(list, after, JOBS_READ_AT_ONCE.min(limit - all.len()))?;
        let Some(last) = part.last() else { break };
        after = Some(last.row.number);
        bytes += part.iter().map(|job| job.row.size()).sum::<usize>();
        all.extend(part);
    }
    let count = if bytes > MAX_PAGE_BYTES && all.len() > 1 { all.len() - 1 } else { limit - 1 };
    Ok((all, count))
}

/// Query parameters of a log.
struct LogQuery {
    /// Number of the line to start after.
    after: u64,
    page: Pagination,
}

impl Extractor for LogQuery {
    fn describe(to: &mut OperationDoc) {
        to.query::<u64>("after", "Only lines after this number");
        Pagination::describe(to);
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<LogQuery> {
        let mut query = from.query()?;
        let given = query.iter().position(|(name, _)| name == "after").map(|at| query.remove(at).1);
        let number = |value: String| {
            // SQLite's integers go up to 2^63 - 1.
            value
                .parse()
                .ok()
                .filter(|n| *n <= i64::MAX as u64)
                .ok_or_else(|| Error::input("after", format!("{value:?}"), "the number of a line, or 0"))
        };
        let after = given.map(number).transpose()?.unwrap_or(0);
        Ok(LogQuery { after, page: Pagination::from_query(&query)? })
    }
}

fn log(
    app: &RequestContext,
    (PathId(id), LogQuery { after, page }): (PathId, LogQuery),
) -> Result<JobLogPage> {
    let after = page.after("log")?.unwrap_or(0).max(after).min(i64::MAX as u64);
    let mut lines = app.jobs().log(&id, after, page.fetch_limit())?;
    let next = page.truncate("log", &mut lines, |l| l.number);
    Ok(JobLogPage { lines: lines.into_iter().map(LogLineOut::from).collect(), next })
}

fn update(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<JobPatch>),
) -> Result<JobOut> {
    body.check()?;
    Ok(app.jobs().annotate(&id, body.name.as_deref(), body.note.as_deref())?.into())
}

fn remove(app: &RequestContext, PathId(id): PathId) -> Result<OperationResponse> {
    Ok(match app.jobs().delete(&id)? {
        DeleteOutcome::Cancelled(job) => (202, JobOut::from(*job)).into_response(),
        DeleteOutcome::Removed => ().into_response(),
    })
}

fn events(
    app: &RequestContext,
    (PathId(id), LastEventId(seen)): (PathId, LastEventId),
) -> Result<OperationResponse> {
    let (watcher, viewer) = app.jobs().watch(&id, seen)?;
    Ok(if watcher.exhausted() {
        ().into_response()
    } else {
        OperationResponse::ok(Payload::EventStream(Box::new(JobEvents { watcher, viewer })))
    })
}

/// A job's events as a caller may see them.
struct JobEvents {
    watcher: Watcher,
    viewer: Principal,
}

/// `done` for a job that has ended, otherwise `progress`.
impl EventStream for JobEvents {
    fn next(&mut self) -> NextEvent<'_> {
        Box::pin(async {
            let (id, job) = self.watcher.next().await?;
            let job = conceal_job(job, &self.viewer);
            let name = if job.row.state.ended() { "done" } else { "progress" };
            let data = serde_json::to_string(&JobOut::from(job)).ok()?;
            Some(ServerEvent { id: Some(id), name, data })
        })
    }

    fn has_last_word(&self) -> bool {
        true
    }
}
