//! Jobs of all kinds.

use crate::error::{Error, Result};
use crate::job::{Deleted, Watcher};
use crate::serve::app::App;
use crate::serve::operation::{
    ACT, Asked, Content, Described, Events, Id, Input, LastEvent, Next, Operation, Output, Page, READ, Reply,
    Told, delete, get,
};
use crate::serve::problem::Answer;
use crate::serve::wire::{JobOut, Jobs, LineOut, Log};
use crate::store::{JobList, JobState};

/// What can be asked of jobs.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_jobs", "/v1/jobs", "jobs", READ)
            .about(
                "Jobs, oldest first unless asked otherwise.\n\nResults may be large, those of diagnoses above all: a list that is \
                 looked at often leaves them out by `results=false`.",
            )
            .leads_to(200, "/v1/jobs/{id}", "/jobs/0/id")
            .does(list),
        get("get_job", "/v1/jobs/{id}", "jobs", READ)
            .about("One job.")
            .refuses(&[(404, "")])
            .does(|app, Id(id)| Ok(JobOut::from(app.jobs().get(&id)?))),
        delete("delete_job", "/v1/jobs/{id}", "jobs", ACT)
            .about("Cancels a job that has not ended (202); forgets one that has (204).")
            .answers::<JobOut>(202, "It is told to stop")
            .answers_nothing(204, "Forgotten")
            .refuses(&[(404, "")])
            .does(remove),
        get("get_job_log", "/v1/jobs/{id}/log", "jobs", READ)
            .about(
                "What happened to a job, line by line: stages, rounds, warnings, the server's restarts, its end.\n\nThe latest \
                 1000 lines are kept for as long as the job. To follow it, ask again with `after`.",
            )
            .refuses(&[(404, "")])
            .does(log),
        get("follow_job", "/v1/jobs/{id}/events", "jobs", READ)
            .about(
                "Follows a job: server-sent events `progress`, and `done` at the end, each with the job as data. \
                 With\n`Last-Event-ID`, only what came after; 204 if nothing ever will.",
            )
            .answers_media(200, "Events", &["text/event-stream"])
            .answers_nothing(204, "The job has ended and its last event was seen")
            .refuses(&[(404, ""), (422, "")])
            .only_http()
            .does(events),
    ]
}

/// Which jobs, in which order, and which part of them.
struct Listed(JobList, Page);

impl Input for Listed {
    fn describe(to: &mut Described) {
        to.query::<String>("order", "`oldest` (default) or `newest` first");
        to.query::<String>("state", "Only jobs in this state");
        to.query::<String>("kind", "Only jobs of this kind: `train`, `evaluate`, ...");
        to.query::<bool>("results", "With their results, which may be large; `true` if absent");
        Page::describe(to);
    }

    fn read(from: &mut Asked) -> Answer<Listed> {
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
        Ok(Listed(JobList { newest, state, kind, bare }, Page::from_query(&query)?))
    }
}

fn list(app: &App, Listed(list, page): Listed) -> Result<Jobs> {
    let kinds = app.jobs().kinds();
    if let Some(unknown) = list.kind.as_ref().filter(|k| !kinds.contains(&k.as_str())) {
        return Err(Error::input("kind", format!("{unknown:?}"), format!("one of {}", kinds.join(", "))));
    }
    // A cursor goes on with the list it came from.
    let name = if list.newest { "jobs-newest" } else { "jobs" };
    let mut all = app.jobs().list(&list, page.after(name)?, page.fetch())?;
    let next = page.cut(name, &mut all, |j| j.row.number);
    Ok(Jobs { jobs: all.into_iter().map(JobOut::from).collect(), next })
}

/// Which part of a log.
struct Lines {
    /// Number of the last line seen.
    after: u64,
    page: Page,
}

impl Input for Lines {
    fn describe(to: &mut Described) {
        to.query::<u64>("after", "Only lines after this number");
        Page::describe(to);
    }

    fn read(from: &mut Asked) -> Answer<Lines> {
        let mut query = from.query()?;
        let given = query.iter().position(|(name, _)| name == "after").map(|at| query.remove(at).1);
        let number = |value: String| {
            // SQLite counts to 2^63 - 1.
            value
                .parse()
                .ok()
                .filter(|n| *n <= i64::MAX as u64)
                .ok_or_else(|| Error::input("after", format!("{value:?}"), "the number of a line, or 0"))
        };
        let after = given.map(number).transpose()?.unwrap_or(0);
        Ok(Lines { after, page: Page::from_query(&query)? })
    }
}

fn log(app: &App, (Id(id), Lines { after, page }): (Id, Lines)) -> Result<Log> {
    let after = page.after("log")?.unwrap_or(0).max(after).min(i64::MAX as u64);
    let mut lines = app.jobs().log(&id, after, page.fetch())?;
    let next = page.cut("log", &mut lines, |l| l.number);
    Ok(Log { lines: lines.into_iter().map(LineOut::from).collect(), next })
}

fn remove(app: &App, Id(id): Id) -> Result<Reply> {
    Ok(match app.jobs().delete(&id)? {
        Deleted::Cancelled(job) => (202, JobOut::from(*job)).reply(),
        Deleted::Forgotten => ().reply(),
    })
}

fn events(app: &App, (Id(id), LastEvent(seen)): (Id, LastEvent)) -> Result<Reply> {
    let watcher = app.jobs().watch(&id, seen)?;
    Ok(if watcher.exhausted() { ().reply() } else { Reply::of(Content::Events(Box::new(watcher))) })
}

/// `done` for a job that has ended, else `progress`.
impl Events for Watcher {
    fn next(&mut self) -> Next<'_> {
        Box::pin(async {
            let (id, job) = Watcher::next(self).await?;
            let name = if job.row.state.ended() { "done" } else { "progress" };
            let data = serde_json::to_string(&JobOut::from(job)).ok()?;
            Some(Told { id: Some(id), name, data })
        })
    }

    fn has_last_word(&self) -> bool {
        true
    }
}
