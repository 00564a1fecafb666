//! Jobs of all kinds.

use super::OPERATIONS;
use crate::error::{Error, Result};
use crate::job::Deleted;
use crate::serve::app::App;
use crate::serve::operation::{
    ACT, Asked, Content, Described, Id, Input, Operation, Output, Page, READ, Reply, delete, get,
};
use crate::serve::problem::Answer;
use crate::serve::wire::{JobOut, Jobs};
use crate::store::{JobList, JobState};

/// What can be asked of jobs.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_jobs", "/v1/jobs", "jobs", READ)
            .about("Jobs, oldest first unless asked otherwise.")
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

/// The number of the last event seen, 0 if none was.
struct LastEvent(u64);

impl Input for LastEvent {
    fn describe(to: &mut Described) {
        to.header::<u64>("Last-Event-ID", "Number of the last event seen");
    }

    fn read(from: &mut Asked) -> Answer<LastEvent> {
        from.last_event().map(LastEvent)
    }
}

/// Which jobs, in which order, and which part of them.
struct Listed(JobList, Page);

impl Input for Listed {
    fn describe(to: &mut Described) {
        to.query::<String>("order", "`oldest` (default) or `newest` first");
        to.query::<String>("state", "Only jobs in this state");
        to.query::<String>("kind", "Only jobs of this kind: `train`, `evaluate`, ...");
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
        let kinds: Vec<&str> = OPERATIONS.iter().filter_map(|o| o.job).map(|(kind, _)| kind).collect();
        let kind = taken("kind");
        if let Some(unknown) = kind.as_ref().filter(|k| !kinds.contains(&k.as_str())) {
            let allowed = format!("one of {}", kinds.join(", "));
            return Err(Error::input("kind", format!("{unknown:?}"), allowed).into());
        }
        Ok(Listed(JobList { newest, state, kind }, Page::from_query(&query)?))
    }
}

fn list(app: &App, Listed(list, page): Listed) -> Result<Jobs> {
    // A cursor goes on with the list it came from.
    let name = if list.newest { "jobs-newest" } else { "jobs" };
    let mut all = app.jobs().list(&list, page.after(name)?, page.fetch())?;
    let next = page.cut(name, &mut all, |j| j.row.number);
    Ok(Jobs { jobs: all.into_iter().map(JobOut::from).collect(), next })
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
