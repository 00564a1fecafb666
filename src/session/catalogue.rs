//! The built-in tasks, assembled once and shared by all worlds.

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::task::action::{Component, Quantity};
use crate::task::{FAMILIES, Family, Scene, Task, custom};

/// Every built-in family with its tasks.
pub struct Catalogue {
    families: Vec<(&'static Family, Arc<[Task]>)>,
}

/// The tasks a world may be reset to.
#[derive(Clone)]
pub struct TaskSet {
    /// `bowling`, `bowling:017` or `custom:name`.
    pub name: String,
    /// The built-in family, unless the task is custom.
    pub family: Option<&'static Family>,
    /// One or more.
    pub tasks: Arc<[Task]>,
}

impl Catalogue {
    /// Assembles all families.
    pub fn new() -> Catalogue {
        Catalogue { families: FAMILIES.iter().map(|f| (*f, (f.tasks)().into())).collect() }
    }

    /// All families in the order of the registry.
    pub fn families(&self) -> impl Iterator<Item = (&'static Family, &[Task])> {
        self.families.iter().map(|(f, tasks)| (*f, &tasks[..]))
    }

    /// A family's tasks.
    pub fn family(&self, name: &str) -> Result<TaskSet> {
        let (family, tasks) = self.families.iter().find(|(f, _)| f.name == name).ok_or_else(|| {
            let known = self.families.iter().map(|(f, _)| f.name.to_string()).collect();
            Error::NotFound { kind: "task family", id: name.to_string(), known }
        })?;
        if tasks.is_empty() {
            return Err(Error::Failed(format!("the family {name} has no certified tasks")));
        }
        Ok(TaskSet { name: name.into(), family: Some(family), tasks: tasks.clone() })
    }

    /// One task by id, `bowling:017`.
    pub fn task(&self, id: &str) -> Result<Task> {
        let family = self.family(id.split(':').next().unwrap_or_default())?;
        Ok(family.tasks[family.find(id)?].clone())
    }

    /// What `task` names: a whole family (`bowling`) or one task (`bowling:017`).
    pub fn named(&self, task: &str) -> Result<TaskSet> {
        if !task.contains(':') {
            return self.family(task);
        }
        let one = self.task(task)?;
        let family = self.family(&one.family)?.family;
        Ok(TaskSet { name: one.id.clone(), family, tasks: [one].into() })
    }
}

impl Default for Catalogue {
    fn default() -> Self {
        Catalogue::new()
    }
}

impl TaskSet {
    /// The one task of a user's scene.
    pub fn custom(scene: Scene) -> Result<TaskSet> {
        let task = custom(scene)?;
        for (i, body) in task.scene.bodies.iter().enumerate() {
            let of_place =
                |c: &Component| matches!(c.set, Quantity::X | Quantity::Y) && c.target == body.name;
            if body.position.is_none() && !task.actions().components.iter().any(of_place) {
                let allowed = "a position in m, or an action component that sets x or y";
                return Err(Error::input(format!("bodies[{i}].position"), "missing", allowed));
            }
        }
        Ok(TaskSet { name: task.id.clone(), family: None, tasks: [task].into() })
    }

    /// Index of the task with this id.
    pub fn find(&self, id: &str) -> Result<usize> {
        self.tasks.iter().position(|t| t.id == id).ok_or_else(|| {
            let (first, last) = (&self.tasks[0].id, &self.tasks[self.tasks.len() - 1].id);
            let known = if first == last { vec![first.clone()] } else { vec![format!("{first} to {last}")] };
            Error::NotFound { kind: "task", id: id.to_string(), known }
        })
    }
}
