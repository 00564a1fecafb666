//! What a world looks like: its scene, what its last step brought, and one action's way through it.

use super::action::{Action, unplaceable};
use super::attempt::Trial;
use super::state::{lock, refused};
use super::world::World;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::{Placement, Scene};
use crate::trajectory::Trajectory;
use crate::world::{Rollout, simulate_within};

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
        let trial = Trial { task, actions: &[resolved], latents, stop: true, interventions: &[] };
        let (mut results, interactions) = self.attempt(&trial, |t| t, None, budget)?;
        self.tell_attempts(&trial, &results, interactions);
        match results.pop() {
            Some(Ok(trajectory)) => Ok((scene, trajectory)),
            Some(Err(reason)) => Err(unplaceable(action, &reason)),
            None => Err(Error::Failed("an attempt without a result".into())),
        }
    }

    /// The placed scene and the trajectory of the last step that could be placed, seen again: to the bit what was observed
    /// then, noise and all, whatever latents were set since. It is no attempt: nothing is counted. A reset does not forget it.
    pub fn last_step(&self, budget: &dyn Budget) -> Result<(Scene, Trajectory)> {
        let none = "no step has been made; step the world first, or name the `action` to attempt";
        let made = lock(&self.state).last.clone().ok_or_else(|| refused(none))?;
        let Placement::Valid(scene) = self.tasks.tasks[made.task].place(&made.action) else {
            return Err(Error::Failed("what was placed cannot be placed again".into()));
        };
        let trajectory = match &self.hidden {
            Some(hidden) => lock(hidden).recall(budget, &scene, made.interactions)?,
            None => {
                let rollout =
                    Rollout { latents: made.latents, effects: &self.effects, ..Rollout::of(&scene) };
                let done = simulate_within(budget, &[rollout], self.engine, |_, t| t)?.pop();
                done.ok_or_else(|| Error::Failed("a rollout was lost".into()))?
            }
        };
        Ok((*scene, trajectory))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::budget::Endless;
    use crate::session::watch::Film;
    use crate::session::{Autoreset, Batch, Catalogue, Kind, Reset, WorldConfig, step_many};
    use crate::world::{Engine, Latents};

    fn world(kind: Kind, noise: f64) -> Arc<World> {
        let config = WorldConfig {
            tasks: Catalogue::new().named("bowling:000").unwrap(),
            kind,
            engine: Engine::Auto,
            latents: Latents::default(),
            effects: None,
            noise,
            budget: None,
            sealed: None,
            seed: 3,
        };
        Arc::new(World::new(config).unwrap())
    }

    /// Actions that can be placed.
    fn placeable(world: &World, count: usize) -> Vec<Action> {
        let fits = |a: &Action| world.scene(None, Some(a)).is_ok();
        (0..1000).map(Action::Index).filter(fits).take(count).collect()
    }

    #[test]
    fn the_last_step_is_seen_again_to_the_bit_whatever_came_after() {
        for (kind, noise) in [(Kind::Sim, 0.0), (Kind::Real, 0.0), (Kind::Real, 0.01)] {
            let world = world(kind, noise);
            let actions = placeable(&world, 3);
            assert!(matches!(world.last_step(&Endless), Err(Error::Refused { .. })));
            let batch = |action: &Action| {
                let batch = Batch {
                    actions: vec![action.clone()],
                    task: None,
                    trajectories: true,
                    stop: true,
                    interventions: Vec::new(),
                };
                world.rollout(&batch, &Endless).unwrap().results.remove(0).unwrap()
            };
            // Noise is another for each attempt: so that the step is not the first.
            let before = batch(&actions[0]);
            let told = world.watch(0);
            world.reset(&Reset::default()).unwrap();
            let step = world.step(&actions[0], &Endless).unwrap();
            let again = || world.last_step(&Endless).unwrap().1;
            let seen = again();
            assert_eq!(seen.outcome.steps, step.steps);
            assert_eq!(seen.bodies[0].x == before.bodies[0].x, noise == 0.0);
            let watched = |number: usize| format!("{:?}", told.films().swap_remove(number));
            assert_eq!(format!("{:?}", Film::of(&seen)), watched(0), "what those who watched were told");
            // Neither attempts beside the episode, nor other latents, nor a reset, nor what cannot be placed change it.
            batch(&actions[1]);
            if kind == Kind::Sim {
                world.set_latents(Latents { restitution: Some(0.9), ..Latents::default() }).unwrap();
            }
            world.reset(&Reset::default()).unwrap();
            let unplaceable = (0..1000).map(Action::Index).find(|a| world.scene(None, Some(a)).is_err());
            assert!(world.step(&unplaceable.unwrap(), &Endless).unwrap().invalid.is_some());
            let spent = world.interactions();
            assert_eq!(format!("{:?}", again()), format!("{seen:?}"));
            assert_eq!(world.interactions(), spent, "it is no attempt");
            // A step in a batch that begins the next episode at once.
            step_many(std::slice::from_ref(&world), &actions[2..], Autoreset::SameStep, None, &Endless)
                .unwrap();
            assert_eq!(format!("{:?}", Film::of(&again())), watched(2));
        }
    }
}
