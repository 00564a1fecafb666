//! Families and tasks.

use crate::error::{Error, Result};
use crate::serve::app::App;
use crate::serve::operation::{Asked, Described, Input, Operation, Page, READ, get};
use crate::serve::problem::Answer;
use crate::serve::wire::{Families, FamilyOut, FamilyTasks, TaskOut};
use crate::task::Task;

/// What can be asked about tasks.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_families", "/v1/tasks", "tasks", READ).about("Families of tasks.").does(families),
        get("list_tasks", "/v1/tasks/{family}", "tasks", READ)
            .about("Tasks of a family.")
            .refuses(&[(404, "")])
            .does(family),
        get("get_task", "/v1/tasks/{family}/{number}", "tasks", READ)
            .about("One task with its scene.")
            .refuses(&[(404, "")])
            .does(task),
    ]
}

/// The `{family}` of the path.
struct OfFamily(String);

/// The `{number}` of the path: `17` or `017`.
struct Number(String);

impl Input for OfFamily {
    fn describe(to: &mut Described) {
        to.path("family", Some("bowling"));
    }

    fn read(from: &mut Asked) -> Answer<OfFamily> {
        from.part("family").map(OfFamily)
    }
}

impl Input for Number {
    fn describe(to: &mut Described) {
        to.path("number", Some("017"));
    }

    fn read(from: &mut Asked) -> Answer<Number> {
        from.part("number").map(Number)
    }
}

fn families(app: &App, page: Page) -> Result<Families> {
    let seen = page.after("families")?.unwrap_or(0);
    let all = app.catalogue.families().enumerate().skip(seen).take(page.fetch());
    let mut rows: Vec<_> = all.map(|(i, (f, tasks))| (i + 1, FamilyOut::new(f, tasks))).collect();
    let next = page.cut("families", &mut rows, |r| r.0);
    Ok(Families { families: rows.into_iter().map(|r| r.1).collect(), next })
}

fn family(app: &App, (OfFamily(name), page): (OfFamily, Page)) -> Result<FamilyTasks> {
    app.catalogue.family(&name)?;
    let found = app.catalogue.families().find(|(f, _)| f.name == name);
    let (family, tasks) = found.ok_or_else(|| Error::Failed("a family came and went".into()))?;
    let seen = page.after(&name)?.unwrap_or(0);
    let mut rows: Vec<(usize, &Task)> = (1..).zip(tasks).skip(seen).take(page.fetch()).collect();
    let next = page.cut(&name, &mut rows, |r| r.0);
    Ok(FamilyTasks::new(family, &tasks[0], rows.into_iter().map(|r| r.1), next))
}

fn task(app: &App, (OfFamily(family), Number(number)): (OfFamily, Number)) -> Result<TaskOut> {
    let tasks = app.catalogue.family(&family)?.tasks;
    let found = number.parse::<usize>().ok().and_then(|n| tasks.get(n)).cloned();
    found.map(TaskOut::from).ok_or_else(|| Error::NotFound {
        kind: "task",
        id: format!("{family}:{number}"),
        known: vec![format!("{family}:000 to {}", tasks[tasks.len() - 1].id)],
    })
}
