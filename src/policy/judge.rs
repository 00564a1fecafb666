//! A policy judged where it was trained: tasks that it did not learn from, tried in simulated worlds.
//!
//! Source: PHYRE's protocol and measure, as for the real world (`evaluate`, `auccess`): up to 100 valid attempts a task, in the
//! policy's order.
//!
//! Differences from the source: where there are several worlds (draws of a belief, say) every task is tried in each, in the
//! same order, and AUCCESS is the mean over them: what a world is tried in is not known when actions are ranked. No real
//! interaction is made.

use super::auccess::{ATTEMPTS, auccess};
use super::evaluate::{EvaluateConfig, candidates};
use super::{CHUNK, Policy, rank};
use crate::error::{Error, Result};
use crate::estimate::Believed;
use crate::progress::Progress;
use crate::task::{Placement, Scene, Task, ValidAction};
use crate::world::{Engine, Rollout, simulate_map};

/// Tasks, and the simulated worlds in which policies are tried on them.
pub struct Judge {
    tasks: Vec<Task>,
    worlds: Vec<Believed>,
    config: EvaluateConfig,
    engine: Engine,
}

impl Judge {
    /// Errors without tasks or without worlds.
    pub fn new(
        tasks: &[Task],
        worlds: Vec<Believed>,
        config: &EvaluateConfig,
        engine: Engine,
    ) -> Result<Judge> {
        for (missing, field, allowed) in [
            (
                tasks.is_empty(),
                "validation tasks",
                "at least one: a family has some, a task on its own has not",
            ),
            (worlds.is_empty(), "worlds", "at least one"),
        ] {
            if missing {
                return Err(Error::input(field, "none", allowed));
            }
        }
        Ok(Judge { tasks: tasks.to_vec(), worlds, config: config.clone(), engine })
    }

    /// AUCCESS of a policy's order of actions, the mean over the worlds.
    pub fn auccess(&self, policy: &dyn Policy, progress: &dyn Progress) -> Result<f64> {
        let mut solved_at: Vec<Vec<Option<usize>>> = vec![Vec::new(); self.worlds.len()];
        for (t, task) in self.tasks.iter().enumerate() {
            progress.report("validate", t as u64, self.tasks.len() as u64)?;
            for (of_world, at) in solved_at.iter_mut().zip(self.tried(policy, task)?) {
                of_world.push(at);
            }
        }
        Ok(solved_at.iter().map(|of_world| auccess(of_world)).sum::<f64>() / self.worlds.len() as f64)
    }

    /// The attempt that solves a task in each world, from 1.
    fn tried(&self, policy: &dyn Policy, task: &Task) -> Result<Vec<Option<usize>>> {
        let actions = candidates(task, &self.config)?;
        let order = rank(policy, task, &actions, CHUNK)?;
        let mut placed =
            order.into_iter().filter_map(|i| placed(task, &actions[i])).take(ATTEMPTS).peekable();
        let mut found = vec![None; self.worlds.len()];
        let mut done = 0;
        while placed.peek().is_some() && found.contains(&None) {
            let scenes: Vec<Box<Scene>> = placed.by_ref().take(self.config.batch.max(1)).collect();
            let open: Vec<usize> = (0..found.len()).filter(|w| found[*w].is_none()).collect();
            let of = |w: &usize| {
                let Believed { latents, effects, .. } = &self.worlds[*w];
                scenes.iter().map(|scene| Rollout { latents: *latents, effects, ..Rollout::of(scene) })
            };
            let rollouts: Vec<Rollout> = open.iter().flat_map(of).collect();
            let solved = simulate_map(&rollouts, self.engine, |_, trajectory| trajectory.solved())?;
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
    use crate::policy::{Random, evaluate, toy};
    use crate::progress::Silent;
    use crate::task::scene::Goal;
    use crate::world::{Latents, effect, simulate};

    /// Red is dropped and solves if it falls below a height within a second: how far it falls is the world's affair.
    fn falling(id: &str, height: f64) -> Task {
        let mut task = toy::task(0.3);
        task.id = id.into();
        task.scene.steps = 240;
        let region = vec![[-99.0, -99.0], [99.0, -99.0], [99.0, height], [-99.0, height]];
        task.scene.goal = Some(Goal::Inside { body: "red".into(), region, hold_s: 0.0, stop: None });
        task
    }

    fn worlds() -> Vec<Believed> {
        let of = |c: f64| Believed::new(Latents::default(), vec![effect::linear_drag(c)]);
        vec![of(0.0), of(3.0)]
    }

    /// The same by the protocol for real worlds, one world at a time.
    fn by_protocol(tasks: &[Task], world: &Believed, config: &EvaluateConfig) -> f64 {
        let mut attempt = |task: &Task, actions: &[ValidAction]| {
            let one = |action: &ValidAction| {
                let Some(scene) = placed(task, action) else { return Ok(None) };
                let (latents, effects) = (world.latents, world.effects.as_slice());
                let rollout = Rollout { latents, effects, ..Rollout::of(&scene) };
                Ok(Some(simulate(&[rollout], Engine::Auto)?[0].solved()))
            };
            actions.iter().map(one).collect()
        };
        evaluate(&Random { seed: 5 }, tasks, config, &mut attempt, &Silent).unwrap().auccess
    }

    #[test]
    fn a_judge_s_auccess_is_the_protocol_s_mean_over_worlds() {
        let tasks = [falling("low", -1.5), falling("high", 4.0), falling("never", -60.0)];
        let config = EvaluateConfig { candidates: 300, seed: 2, batch: 8 };
        let of_each: Vec<f64> = worlds().iter().map(|w| by_protocol(&tasks, w, &config)).collect();
        assert!(of_each[0] != of_each[1], "worlds that differ: {of_each:?}");
        for batch in [1, 8, 64] {
            let config = EvaluateConfig { batch, ..config.clone() };
            let judge = Judge::new(&tasks, worlds(), &config, Engine::Auto).unwrap();
            let found = judge.auccess(&Random { seed: 5 }, &Silent).unwrap();
            assert!((found - of_each.iter().sum::<f64>() / 2.0).abs() < 1e-12, "{found} of {of_each:?}");
        }
    }

    #[test]
    fn without_tasks_or_worlds_there_is_nothing_to_judge_by() {
        let config = EvaluateConfig::phyre(0);
        let refused = |tasks: &[Task], worlds, wanted: &str| {
            let error = Judge::new(tasks, worlds, &config, Engine::Auto).err().unwrap().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        refused(&[], worlds(), "validation tasks");
        refused(&[falling("low", 3.0)], Vec::new(), "worlds");
    }
}
