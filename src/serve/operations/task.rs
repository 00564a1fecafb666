//! Families and tasks.

use crate::error::{Error, Result};
use crate::serve::app::App;
use crate::serve::wire::{Families, FamilyOut, FamilyTasks, TaskOut};

/// All families.
pub fn families(app: &App) -> Families {
    Families { families: app.catalogue.families().map(|(f, tasks)| FamilyOut::new(f, tasks)).collect() }
}

/// A family's tasks.
pub fn family(app: &App, name: &str) -> Result<FamilyTasks> {
    app.catalogue.family(name)?;
    let found = app.catalogue.families().find(|(f, _)| f.name == name);
    let (family, tasks) = found.ok_or_else(|| Error::Failed("a family came and went".into()))?;
    Ok(FamilyTasks::new(family, tasks))
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
