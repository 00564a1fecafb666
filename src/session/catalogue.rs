//! The built-in tasks, assembled once and shared by all worlds.

use std::sync::{Arc, OnceLock};

use super::observation::{ObservationLayout, feature_names, object_names};
use crate::error::{Error, Result};
use crate::task::action::{ActionComponent, ActionQuantity};
use crate::task::{Family, Learning, Scene, Split, Task, custom, explorable, families, unknown_family};
use crate::world::effect;

/// Every built-in family with its tasks.
pub struct Catalogue {
    families: Vec<(&'static Family, TaskSet)>,
}

/// The tasks that a world can be reset to.
#[derive(Clone)]
pub struct TaskSet {
    /// `bowling`, `bowling:017` or `custom:name`.
    pub name: String,
    /// The built-in family, unless the task is custom.
    pub family: Option<&'static Family>,
    /// Never empty.
    pub tasks: Arc<[Task]>,
    index: Arc<TaskSetIndex>,
}

/// Values derived from the tasks, cached because every step of a vector environment needs them.
struct TaskSetIndex {
    /// Indices of the tasks of each split, in the order of [`Split::ALL`].
    pools: [Arc<[usize]>; 3],
    /// Indices of all tasks.
    all: Arc<[usize]>,
    /// Names of the objects that observations contain: of all tasks of the family.
    objects: OnceLock<Vec<String>>,
    /// Observation layout of each task.
    layouts: Vec<OnceLock<ObservationLayout>>,
}

/// A task with its observation layout.
#[derive(Clone, Copy)]
pub(super) struct TaskContext<'a> {
    pub task: &'a Task,
    pub layout: &'a ObservationLayout,
}

impl Catalogue {
    /// Assembles all families.
    pub fn new() -> Catalogue {
        let set = |f: &'static Family| TaskSet::new(f.name.into(), Some(f), f.tasks().into());
        Catalogue { families: families().iter().map(|f| (*f, set(f))).collect() }
    }

    /// All families in the order of the registry.
    pub fn families(&self) -> impl Iterator<Item = (&'static Family, &[Task])> {
        self.families.iter().map(|(f, set)| (*f, &set.tasks[..]))
    }

    /// A family's tasks.
    pub fn family(&self, name: &str) -> Result<TaskSet> {
        let (_, set) = self
            .families
            .iter()
            .find(|(f, _)| f.name == name)
            .ok_or_else(|| unknown_family(name, self.families.iter().map(|(f, _)| f.name)))?;
        if set.tasks.is_empty() {
            return Err(Error::Failed(format!("the family {name} has no certified tasks")));
        }
        Ok(set.clone())
    }

    /// One task by id, `bowling:017`.
    pub fn task(&self, id: &str) -> Result<Task> {
        let family = self.family(id.split(':').next().unwrap_or_default())?;
        Ok(family.tasks[family.find(id)?].clone())
    }

    /// The tasks named by `task`: a whole family (`bowling`) or one task (`bowling:017`).
    pub fn named(&self, task: &str) -> Result<TaskSet> {
        if !task.contains(':') {
            return self.family(task);
        }
        let one = self.task(task)?;
        let whole = self.family(&one.family)?;
        let own = TaskSet::new(one.id.clone(), whole.family, [one].into());
        // One task has the features of its family, so that a policy fits both.
        own.index.objects.get_or_init(|| whole.objects().to_vec());
        Ok(own)
    }
}

impl Default for Catalogue {
    fn default() -> Self {
        Catalogue::new()
    }
}

impl TaskSet {
    fn new(name: String, family: Option<&'static Family>, tasks: Arc<[Task]>) -> TaskSet {
        let of = |s: Split| (0..tasks.len()).filter(|i| tasks[*i].split == s).collect();
        let index = TaskSetIndex {
            pools: Split::ALL.map(of),
            all: (0..tasks.len()).collect(),
            objects: OnceLock::new(),
            layouts: tasks.iter().map(|_| OnceLock::new()).collect(),
        };
        TaskSet { name, family, tasks, index: Arc::new(index) }
    }

    /// Default training settings for policies on these tasks.
    pub fn learning(&self) -> &'static Learning {
        self.family.map_or(&Learning::STANDARD, |f| &f.learning)
    }

    /// Indices of the tasks of a split, or of all tasks; may be empty.
    pub(super) fn pool(&self, split: Option<Split>) -> &Arc<[usize]> {
        match split {
            Some(split) => &self.index.pools[split as usize],
            None => &self.index.all,
        }
    }

    /// The task at this index.
    pub(super) fn context(&self, index: usize) -> TaskContext<'_> {
        let task = &self.tasks[index];
        TaskContext {
            task,
            layout: self.index.layouts[index]
                .get_or_init(|| ObservationLayout::of(&task.scene, self.objects())),
        }
    }

    /// Names of an observation's features, three per object.
    pub fn feature_names(&self) -> Vec<String> {
        feature_names(self.objects())
    }

    /// Names of the objects that observations contain.
    fn objects(&self) -> &[String] {
        self.index.objects.get_or_init(|| object_names(self.tasks.iter().map(|t| &t.scene)))
    }

    /// A set with the single task of a user's scene.
    pub fn custom(scene: Scene) -> Result<TaskSet> {
        TaskSet::of_scene(custom(scene)?)
    }

    /// The same, but the scene needs no goal.
    pub fn explorable(scene: Scene) -> Result<TaskSet> {
        TaskSet::of_scene(explorable(scene)?)
    }

    fn of_scene(task: Task) -> Result<TaskSet> {
        effect::validate_terms(&task.scene.effects)?;
        for (i, body) in task.scene.bodies.iter().enumerate() {
            let of_place = |c: &ActionComponent| {
                matches!(c.set, ActionQuantity::X | ActionQuantity::Y) && c.target == body.name
            };
            if body.position.is_none() && !task.actions().components.iter().any(of_place) {
                let allowed = "a position in m, or an action component that sets x or y";
                return Err(Error::input(format!("bodies[{i}].position"), "missing", allowed));
            }
        }
        Ok(TaskSet::new(task.id.clone(), None, [task].into()))
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
