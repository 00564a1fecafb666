//! Custom tasks: any scene file with a placement action.

use super::{Scene, Split, Task};
use crate::error::{Error, Result};

/// A task from a user's validated scene, which must have an action space and a goal.
pub fn custom(scene: Scene) -> Result<Task> {
    scene.validate()?;
    if scene.action.is_none() {
        return Err(Error::input("action", "missing", "an action space: what an action sets in the scene"));
    }
    if scene.goal.is_none() {
        return Err(Error::input("goal", "missing", "a goal: what solves the task"));
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
