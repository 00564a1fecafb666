//! What a world looks like: its scene, and one action's way through it.

use super::action::{Action, unplaceable};
use super::attempt::Trial;
use super::world::World;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::{Placement, Scene};
use crate::trajectory::Trajectory;

impl World {
    /// The scene of a task (the current one if `task` is absent) as it stands, or with an action placed in it.
    pub fn scene(&self, task: Option<&str>, action: Option<&Action>) -> Result<Scene> {
        let task = match self.task_or_current(task) {
            Ok((task, _)) => task,
            // A world never reset shows its first task.
            Err(Error::Refused { .. }) => &self.tasks.tasks[0],
            Err(e) => return Err(e),
        };
        let Some(action) = action else { return Ok(task.scene.clone()) };
        match task.place(&action.resolve(task.actions(), "action")?) {
            Placement::Valid(scene) => Ok(*scene),
            Placement::Invalid(reason) => Err(unplaceable(action, &reason)),
        }
    }

    /// The placed scene and the trajectory of one action, for a film; an attempt like any other.
    pub fn film(
        &self,
        task: Option<&str>,
        action: &Action,
        budget: &dyn Budget,
    ) -> Result<(Scene, Trajectory)> {
        let (task, latents) = self.task_or_current(task)?;
        let scene = self.scene(Some(&task.id), Some(action))?;
        let resolved = action.resolve(task.actions(), "action")?;
        let trial = Trial { task, actions: &[resolved], latents, stop: true };
        let (mut results, interactions) = self.attempt(&trial, |t| t, None, budget)?;
        self.tell_attempts(&trial, &results, interactions);
        match results.pop() {
            Some(Ok(trajectory)) => Ok((scene, trajectory)),
            Some(Err(reason)) => Err(unplaceable(action, &reason)),
            None => Err(Error::Failed("an attempt without a result".into())),
        }
    }
}
