//! Families and tasks.

use super::Page;
use crate::error::{Error, Result};
use crate::serve::app::App;
use crate::serve::wire::{Families, FamilyOut, FamilyTasks, TaskOut};
use crate::task::Task;

/// A page of all families.
pub fn families(app: &App, page: &Page) -> Result<Families> {
    let seen = page.after("families")?.unwrap_or(0);
    let all = app.catalogue.families().enumerate().skip(seen).take(page.fetch());
    let mut rows: Vec<_> = all.map(|(i, (f, tasks))| (i + 1, FamilyOut::new(f, tasks))).collect();
    let next = page.cut("families", &mut rows, |r| r.0);
    Ok(Families { families: rows.into_iter().map(|r| r.1).collect(), next })
}

/// A page of a family's tasks.
pub fn family(app: &App, name: &str, page: &Page) -> Result<FamilyTasks> {
    app.catalogue.family(name)?;
    let found = app.catalogue.families().find(|(f, _)| f.name == name);
    let (family, tasks) = found.ok_or_else(|| Error::Failed("a family came and went".into()))?;
    let seen = page.after(name)?.unwrap_or(0);
    let mut rows: Vec<(usize, &Task)> = (1..).zip(tasks).skip(seen).take(page.fetch()).collect();
    let next = page.cut(name, &mut rows, |r| r.0);
    Ok(FamilyTasks::new(family, &tasks[0], rows.into_iter().map(|r| r.1), next))
}

/// Task `number` (`17` or `017`) of a family.
pub fn task(app: &App, family: &str, number: &str) -> Result<TaskOut> {
    let tasks = app.catalogue.family(family)?.tasks;
    let found = number.parse::<usize>().ok().and_then(|n| tasks.get(n)).cloned();
    found.map(TaskOut::from).ok_or_else(|| Error::NotFound {
        kind: "task",
        id: format!("{family}:{number}"),
        known: vec![format!("{family}:000 to {}", tasks[tasks.len() - 1].id)],
    })
}
