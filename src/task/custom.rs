//! Custom tasks: any scene with an action space and, if it is to be solved, a goal.

use super::{Scene, Split, Task};
use crate::error::{Error, Result};

/// A task from a user's scene; errors unless the scene is valid and has an action space and a goal.
pub fn custom(scene: Scene) -> Result<Task> {
    if scene.goal.is_none() && scene.action.is_some() {
        scene.validate()?;
        return Err(Error::input("goal", "missing", "a goal: the condition that solves the task"));
    }
    explorable(scene)
}

/// The same, but the scene needs no goal: actions in it can be measured, but nothing is to be solved.
pub fn explorable(scene: Scene) -> Result<Task> {
    scene.validate()?;
    if scene.action.is_none() {
        let allowed = "an action space: the quantities of the scene that an action sets";
        return Err(Error::input("action", "missing", allowed));
    }
    let name = if scene.name.is_empty() { "scene" } else { &scene.name };
    Ok(Task {
        id: format!("custom:{name}"),
        family: "custom".into(),
        split: Split::Train,
        scene,
        certificate: None,
    })
}
