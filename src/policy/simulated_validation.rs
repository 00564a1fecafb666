//! Validation of a policy in simulation: held-out tasks, evaluated in simulated worlds.
//!
//! Source: PHYRE's protocol and metric, as for the real world (`evaluate`, `auccess`): up to 100 valid attempts per task, in the
//! policy's order.
//!
//! Differences from the source: with several worlds (posterior draws, for example) every task is evaluated in each with the same
//! ranking, since the true world is unknown when actions are ranked; AUCCESS is the mean over worlds. No real interactions are used.

use super::auccess::{MAX_ATTEMPTS, auccess};
use super::data::TrainingPhysics;
use super::evaluate::{EvaluateConfig, candidates};
use super::{CHUNK, Policy, rank};
use crate::error::{Error, Result};
use crate::estimate::ParameterSample;
use crate::progress::Progress;
use crate::task::{Placement, Scene, Task, ValidAction};
use crate::world::{Engine, Rollout, Simulator};

/// Validation tasks and the simulated worlds in which policies are evaluated.
pub struct SimulatedValidator {
    tasks: Vec<Task>,
    worlds: Vec<ParameterSample>,
    config: EvaluateConfig,
    engine: Engine,
}

impl SimulatedValidator {
    /// Errors without tasks or without worlds.
    pub fn new(
        tasks: &[Task],
        worlds: Vec<ParameterSample>,
        config: &EvaluateConfig,
        engine: Engine,
    ) -> Result<SimulatedValidator> {
        for (missing, field, allowed) in [
            (
                tasks.is_empty(),
                "validation tasks",
                "at least one; families have validation tasks, a single task has none",
            ),
            (worlds.is_empty(), "worlds", "at least one"),
        ] {
            if missing {
                return Err(Error::input(field, "none", allowed));
            }
        }
        Ok(SimulatedValidator { tasks: tasks.to_vec(), worlds, config: config.clone(), engine })
    }

    /// Validation in `worlds` of the worlds of a training, as early stopping needs it.
    pub fn of_training(
        physics: &TrainingPhysics,
        tasks: &[Task],
        worlds: usize,
        seed: u64,
    ) -> Result<SimulatedValidator> {
        let worlds = physics.worlds(worlds, seed);
        SimulatedValidator::new(tasks, worlds, &EvaluateConfig::phyre(seed), Engine::Auto)
    }

    /// AUCCESS of a policy's ranking, averaged over the worlds.
    pub fn auccess(&self, policy: &dyn Policy, progress: &dyn Progress) -> Result<f64> {
        let mut solved_at: Vec<Vec<Option<usize>>> = vec![Vec::new(); self.worlds.len()];
        for (t, task) in self.tasks.iter().enumerate() {
            progress.report("validate", t as u64, self.tasks.len() as u64)?;
            for (of_world, at) in solved_at.iter_mut().zip(self.first_success(policy, task, progress)?) {
                of_world.push(at);
            }
        }
        Ok(solved_at.iter().map(|of_world| auccess(of_world)).sum::<f64>() / self.worlds.len() as f64)
    }

    /// First solving attempt of a task in each world, from 1.
    fn first_success(
        &self,
        policy: &dyn Policy,
        task: &Task,
        progress: &dyn Progress,
    ) -> Result<Vec<Option<usize>>> {
        let actions = candidates(task, &self.config)?;
        let order = rank(policy, task, &actions, CHUNK)?;
        let mut placed =
            order.into_iter().filter_map(|i| placed(task, &actions[i])).take(MAX_ATTEMPTS).peekable();
        let mut found = vec![None; self.worlds.len()];
        let mut done = 0;
        while placed.peek().is_some() && found.contains(&None) {
            let scenes: Vec<Box<Scene>> = placed.by_ref().take(self.config.batch.max(1)).collect();
            let open: Vec<usize> = (0..found.len()).filter(|w| found[*w].is_none()).collect();
            let of = |w: &usize| {
                let ParameterSample { latents, effects, .. } = &self.worlds[*w];
                scenes.iter().map(|scene| Rollout { latents: *latents, effects, ..Rollout::of(scene) })
            };
            let rollouts: Vec<Rollout> = open.iter().flat_map(of).collect();
            let solved = Simulator::new(self.engine).budget(&progress).solved(&rollouts)?;
            for (w, of_world) in open.iter().zip(solved.chunks(scenes.len())) {
                found[*w] = of_world.iter().position(|s| *s).map(|k| done + k + 1);
            }
            done += scenes.len();
        }
        Ok(found)
    }
}

fn placed(task: &Task, action: &ValidAction) -> Option<Box<Scene>> {
    match task.place(action) {
        Placement::Valid(scene) => Some(scene),
        Placement::Invalid(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::{RandomPolicy, evaluate, toy};
    use crate::progress::NoProgress;
    use crate::task::scene::Goal;
    use crate::world::{Latents, Simulator, effect};

    /// Red is dropped and solves the task if it falls below a height within a second, which depends on the world.
    fn falling(id: &str, height: f64) -> Task {
        let mut task = toy::task(0.3);
        task.id = id.into();
        task.scene.steps = 240;
        let region = vec![[-99.0, -99.0], [99.0, -99.0], [99.0, height], [-99.0, height]];
        task.scene.goal = Some(Goal::Inside { body: "red".into(), region, hold_s: 0.0, stop: None });
        task
    }

    fn worlds() -> Vec<ParameterSample> {
        let of = |c: f64| ParameterSample::new(Latents::default(), vec![effect::linear_drag(c)]);
        vec![of(0.0), of(3.0)]
    }

    /// Reference: the protocol for real worlds, one world at a time.
    fn by_protocol(tasks: &[Task], world: &ParameterSample, config: &EvaluateConfig) -> f64 {
        let mut attempt = |task: &Task, actions: &[ValidAction]| {
            let one = |action: &ValidAction| {
                let Some(scene) = placed(task, action) else { return Ok(None) };
                let (latents, effects) = (world.latents, world.effects.as_slice());
                let rollout = Rollout { latents, effects, ..Rollout::of(&scene) };
                Ok(Some(Simulator::new(Engine::Auto).run(&[rollout])?[0].solved()))
            };
            actions.iter().map(one).collect()
        };
        evaluate(&RandomPolicy { seed: 5 }, tasks, config, &mut attempt, &NoProgress).unwrap().auccess
    }

    #[test]
    fn auccess_is_the_protocol_mean_over_worlds() {
        let tasks = [falling("low", -1.5), falling("high", 4.0), falling("never", -60.0)];
        let config = EvaluateConfig { candidates: 300, seed: 2, batch: 8 };
        let of_each: Vec<f64> = worlds().iter().map(|w| by_protocol(&tasks, w, &config)).collect();
        assert!(of_each[0] != of_each[1], "worlds that differ: {of_each:?}");
        for batch in [1, 8, 64] {
            let config = EvaluateConfig { batch, ..config.clone() };
            let judge = SimulatedValidator::new(&tasks, worlds(), &config, Engine::Auto).unwrap();
            let found = judge.auccess(&RandomPolicy { seed: 5 }, &NoProgress).unwrap();
            assert!((found - of_each.iter().sum::<f64>() / 2.0).abs() < 1e-12, "{found} of {of_each:?}");
        }
    }

    #[test]
    fn rejects_missing_tasks_or_worlds() {
        let config = EvaluateConfig::phyre(0);
        let refused = |tasks: &[Task], worlds, wanted: &str| {
            let error =
                SimulatedValidator::new(tasks, worlds, &config, Engine::Auto).err().unwrap().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        refused(&[], worlds(), "validation tasks");
        refused(&[falling("low", 3.0)], Vec::new(), "worlds");
    }
}
