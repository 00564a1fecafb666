//! Scenes and trajectories to draw: of a task, of the world's last step, or of one action.

use super::World;
use super::attempt::AttemptSpec;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::session::action::{Action, unplaceable};
use crate::session::state::conflict;
use crate::sync::lock;
use crate::task::{Placement, Scene};
use crate::trajectory::Trajectory;
use crate::world::{Rollout, Simulator};

impl World {
    /// The scene of a task (default: the current one), with `action` placed in it if given.
    pub fn scene(&self, task: Option<&str>, action: Option<&Action>) -> Result<Scene> {
        let task = match self.task_or_current(task) {
            Ok((task, _)) => task,
            // Before the first reset there is no current task; show the first.
            Err(Error::Refused { .. }) => &self.tasks.tasks[0],
            Err(e) => return Err(e),
        };
        let Some(action) = action else { return Ok(task.scene.clone()) };
        match task.place(&action.resolve(task.actions(), "action")?) {
            Placement::Valid(scene) => Ok(*scene),
            Placement::Invalid(reason) => Err(unplaceable(action, &reason)),
        }
    }

    /// The placed scene and the trajectory of one action. Counts as an attempt.
    pub fn record(
        &self,
        task: Option<&str>,
        action: &Action,
        budget: &dyn Budget,
    ) -> Result<(Scene, Trajectory)> {
        let (task, latents) = self.task_or_current(task)?;
        let scene = self.scene(Some(&task.id), Some(action))?;
        let resolved = action.resolve(task.actions(), "action")?;
        let trial = AttemptSpec { task, actions: &[resolved], latents, stop: true, interventions: &[] };
        match self.attempt_one(&trial, budget)?.0 {
            Ok(trajectory) => Ok((scene, trajectory)),
            Err(reason) => Err(unplaceable(action, &reason)),
        }
    }

    /// The placed scene and the trajectory of the last step that could be placed. Bit-identical to the original observation,
    /// including its noise, even if latents were changed or the world was reset since. Not counted as an attempt.
    pub fn last_step(&self, budget: &dyn Budget) -> Result<(Scene, Trajectory)> {
        let none = "no step has been made; step the world first, or give the `action` to attempt";
        let made = lock(&self.state).last.clone().ok_or_else(|| conflict(none))?;
        let Placement::Valid(scene) = self.tasks.tasks[made.task].place(&made.action) else {
            return Err(Error::Failed("the last step's action can no longer be placed".into()));
        };
        let trajectory = match &self.hidden {
            Some(hidden) => lock(hidden).recall(budget, &scene, made.interactions)?,
            None => {
                let rollout =
                    Rollout { latents: made.latents, effects: &self.effects, ..Rollout::of(&scene) };
                Simulator::new(self.engine).budget(budget).one(rollout)?
            }
        };
        Ok((*scene, trajectory))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::budget::Unlimited;
    use crate::session::watch::Recording;
    use crate::session::{Autoreset, Catalogue, Reset, RolloutRequest, WorldConfig, WorldKind, step_many};
    use crate::world::Latents;

    fn world(kind: WorldKind, noise: f64) -> Arc<World> {
        let tasks = Catalogue::new().named("bowling:000").unwrap();
        Arc::new(World::new(WorldConfig { noise, seed: 3, ..WorldConfig::new(tasks, kind) }).unwrap())
    }

    /// Actions that can be placed.
    fn placeable(world: &World, count: usize) -> Vec<Action> {
        let fits = |a: &Action| world.scene(None, Some(a)).is_ok();
        (0..1000).map(Action::Index).filter(fits).take(count).collect()
    }

    #[test]
    fn last_step_is_reproduced_bit_identically() {
        for (kind, noise) in [(WorldKind::Sim, 0.0), (WorldKind::Real, 0.0), (WorldKind::Real, 0.01)] {
            let world = world(kind, noise);
            let actions = placeable(&world, 3);
            assert!(matches!(world.last_step(&Unlimited), Err(Error::Refused { .. })));
            let batch = |action: &Action| {
                let batch = RolloutRequest {
                    actions: vec![action.clone()],
                    task: None,
                    trajectories: true,
                    stop: true,
                    interventions: Vec::new(),
                };
                world.rollout(&batch, &Unlimited).unwrap().results.remove(0).unwrap()
            };
            // Noise depends on the attempt's number, so the step must not be the first attempt.
            let before = batch(&actions[0]);
            let told = world.watch(0);
            world.reset(&Reset::default()).unwrap();
            let step = world.step(&actions[0], None, &Unlimited).unwrap();
            let again = || world.last_step(&Unlimited).unwrap().1;
            let seen = again();
            assert_eq!(seen.outcome.steps, step.steps);
            assert_eq!(seen.bodies[0].x == before.bodies[0].x, noise == 0.0);
            let watched = |number: usize| format!("{:?}", told.recordings().swap_remove(number));
            assert_eq!(format!("{:?}", Recording::of(&seen)), watched(0), "same as the published recording");
            // Attempts outside the episode, new latents, a reset and an invalid action do not change it.
            batch(&actions[1]);
            if kind == WorldKind::Sim {
                world.set_latents(Latents { restitution: Some(0.9), ..Latents::default() }).unwrap();
            }
            world.reset(&Reset::default()).unwrap();
            let unplaceable = (0..1000).map(Action::Index).find(|a| world.scene(None, Some(a)).is_err());
            assert!(world.step(&unplaceable.unwrap(), None, &Unlimited).unwrap().invalid.is_some());
            let spent = world.interactions();
            assert_eq!(format!("{:?}", again()), format!("{seen:?}"));
            assert_eq!(world.interactions(), spent, "not counted as an attempt");
            // A batched step with automatic reset.
            step_many(std::slice::from_ref(&world), &actions[2..], Autoreset::SameStep, None, &Unlimited)
                .unwrap();
            assert_eq!(format!("{:?}", Recording::of(&again())), watched(2));
        }
    }
}
