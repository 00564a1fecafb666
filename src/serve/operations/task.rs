//! Families and tasks.

use crate::error::{Error, Result};
use crate::serve::operation::{Extractor, Operation, OperationDoc, OperationRequest, Pagination, READ, get};
use crate::serve::problem::HandlerResult;
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{FamiliesPage, FamilyOut, FamilyTasksPage, TaskOut};
use crate::task::Task;

/// Operations on tasks.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_families", "/v1/tasks", "tasks", READ)
            .about("Lists the families of tasks.")
            .handler(families),
        get("list_tasks", "/v1/tasks/{family}", "tasks", READ)
            .about("Lists the tasks of a family.")
            .errors(&[(404, "")])
            .handler(family),
        get("get_task", "/v1/tasks/{family}/{number}", "tasks", READ)
            .about("Returns a task with its scene.")
            .errors(&[(404, "")])
            .handler(task),
    ]
}

/// The `{family}` of the path.
struct FamilyParam(String);

/// The `{number}` of the path: `17` or `017`.
struct TaskNumberParam(String);

impl Extractor for FamilyParam {
    fn describe(to: &mut OperationDoc) {
        to.path("family", Some("bowling"));
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<FamilyParam> {
        from.path_parameter("family").map(FamilyParam)
    }
}

impl Extractor for TaskNumberParam {
    fn describe(to: &mut OperationDoc) {
        to.path("number", Some("017"));
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<TaskNumberParam> {
        from.path_parameter("number").map(TaskNumberParam)
    }
}

fn families(app: &RequestContext, page: Pagination) -> Result<FamiliesPage> {
    let seen = page.after("families")?.unwrap_or(0);
    let all = app.catalogue.families().enumerate().skip(seen).take(page.fetch_limit());
    let mut rows: Vec<_> = all.map(|(i, (f, tasks))| (i + 1, FamilyOut::new(f, tasks))).collect();
    let next = page.truncate("families", &mut rows, |r| r.0);
    Ok(FamiliesPage { families: rows.into_iter().map(|r| r.1).collect(), next })
}

fn family(
    app: &RequestContext,
    (FamilyParam(name), page): (FamilyParam, Pagination),
) -> Result<FamilyTasksPage> {
    let set = app.catalogue.family(&name)?;
    let seen = page.after(&name)?.unwrap_or(0);
    let mut rows: Vec<(usize, &Task)> =
        (1..).zip(set.tasks.iter()).skip(seen).take(page.fetch_limit()).collect();
    let next = page.truncate(&name, &mut rows, |r| r.0);
    FamilyTasksPage::new(&set, rows.into_iter().map(|r| r.1), next)
}

fn task(
    app: &RequestContext,
    (FamilyParam(family), TaskNumberParam(number)): (FamilyParam, TaskNumberParam),
) -> Result<TaskOut> {
    let tasks = app.catalogue.family(&family)?.tasks;
    let found = number.parse::<usize>().ok().and_then(|n| tasks.get(n)).cloned();
    found.map(TaskOut::from).ok_or_else(|| {
        let known = format!("{family}:000 to {}", tasks[tasks.len() - 1].id);
        Error::not_found("task", format!("{family}:{number}"), [known])
    })
}
