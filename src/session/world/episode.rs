//! Episodes: reset and step.

use std::sync::Arc;

use rand::RngExt;
use serde::Deserialize;
use utoipa::ToSchema;

use super::World;
use super::attempt::AttemptSpec;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::rng;
use crate::session::action::Action;
use crate::session::catalogue::TaskContext;
use crate::session::observation::ObservationLayout;
use crate::session::state::{LastStep, Phase, conflict};
use crate::session::watch::{Recording, StepOutcome, WorldEventKind};
use crate::sync::lock;
use crate::task::{Split, ValidAction};
use crate::trajectory::{Termination, Trajectory};
use crate::world::Latents;

/// Options of a reset; all are optional.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = ResetIn)]
pub struct Reset {
    /// Restarts the world's task sequence.
    pub seed: Option<u64>,
    /// Id of the task. Default: the next of the task sequence.
    pub task: Option<String>,
    /// Split to draw from. Default: `train`.
    pub split: Option<Split>,
}

/// The start of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeStart {
    /// (n_features,) in [0, 1].
    pub observation: Vec<f64>,
    pub task: String,
    pub split: Split,
    /// Its number in the world, from 1.
    pub episode: u64,
}

/// The result of a step: Gymnasium's tuple (never truncated: the number of attempts is part of the task) with its info.
#[derive(Clone, Debug, PartialEq)]
pub struct StepResult {
    /// (n_features,) in [0, 1]: of the final state if the episode has ended, otherwise of the state in which the next action starts.
    pub observation: Vec<f64>,
    /// 0 if not solved; if solved, the AUCCESS of the episode: 1 at the first attempt.
    pub reward: f64,
    /// Whether the task is solved, or all attempts are used.
    pub terminated: bool,
    /// Valid attempts in this episode so far.
    pub attempt: u32,
    /// Why the action could not be placed; `None` if it was.
    pub invalid: Option<String>,
    pub solved: bool,
    /// Simulated time steps.
    pub steps: u32,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    pub collisions: u32,
    pub rolling_steps: u32,
    pub end: Option<Termination>,
}

/// Where a reset gets its task.
pub(super) enum TaskSource {
    /// The task at this index.
    Fixed(usize),
    /// A random one of these indices; never empty.
    Pool(Arc<[usize]>),
}

/// The parts of a trajectory that a step reports.
pub(super) struct StepSummary {
    observation: Vec<f64>,
    solved: bool,
    steps: u32,
    collisions: u32,
    rolling_steps: u32,
    end: Termination,
    /// Recording for watchers; `None` if there are none.
    film: Option<Recording>,
}

impl StepSummary {
    pub(super) fn of(layout: &ObservationLayout, trajectory: &Trajectory, watched: bool) -> StepSummary {
        StepSummary {
            observation: layout.observe(Some(trajectory)),
            solved: trajectory.solved(),
            steps: trajectory.outcome.steps,
            collisions: trajectory.collisions,
            rolling_steps: trajectory.rolling_steps,
            end: trajectory.outcome.end,
            film: watched.then(|| Recording::of(trajectory)),
        }
    }
}

impl World {
    /// Starts an episode.
    pub fn reset(&self, reset: &Reset) -> Result<EpisodeStart> {
        let task_source = self.task_source(reset)?;
        let _turn = lock(&self.turn);
        Ok(self.begin_episode(task_source, reset))
    }

    /// Where a reset gets its task.
    pub(super) fn task_source(&self, reset: &Reset) -> Result<TaskSource> {
        let given = reset.task.as_deref().map(|id| self.tasks.find(id)).transpose()?;
        let pool = self.pool(reset.split)?;
        match (given, reset.split) {
            (Some(task), Some(split)) if !pool.contains(&task) => {
                let own = self.tasks.tasks[task].split.name();
                let allowed = format!("{own:?}, where the task is");
                Err(Error::input("split", format!("{:?}", split.name()), allowed))
            }
            (Some(task), _) => Ok(TaskSource::Fixed(task)),
            (None, _) => Ok(TaskSource::Pool(pool)),
        }
    }

    /// Starts an episode; the caller holds the turn lock.
    pub(super) fn begin_episode(&self, task_source: TaskSource, reset: &Reset) -> EpisodeStart {
        let mut state = lock(&self.state);
        if let Some(seed) = reset.seed {
            state.resets = rng::stream(seed, "reset");
        }
        let index = match task_source {
            TaskSource::Fixed(task) => task,
            TaskSource::Pool(pool) => pool[state.resets.random_range(0..pool.len())],
        };
        state.task = Some(index);
        state.split = reset.split;
        state.phase = Phase::Ready;
        state.attempts = 0;
        state.episodes += 1;
        let (interactions, episode) = (state.interactions, state.episodes);
        drop(state);
        let TaskContext { task, layout } = self.tasks.context(index);
        let reset = || WorldEventKind::Reset { task: task.id.clone(), split: task.split };
        self.events.publish(interactions, reset);
        EpisodeStart { observation: layout.observe(None), task: task.id.clone(), split: task.split, episode }
    }

    /// Attempts one action; see the table of phases in the module documentation. `episode`: number of the episode that the action is
    /// meant for, if it is known: a conflict if another reset has ended it.
    pub fn step(&self, action: &Action, episode: Option<u64>, budget: &dyn Budget) -> Result<StepResult> {
        let _turn = lock(&self.turn);
        let current = lock(&self.state).episodes;
        if let Some(episode) = episode.filter(|e| *e != current) {
            return Err(conflict(&format!(
                "episode {episode} has ended: another reset of this world began episode {current}; reset it, or create a world of your own"
            )));
        }
        let (context, latents) = self.ready_task()?;
        let task = context.task;
        let action = action.resolve(task.actions(), "action")?;
        let trial = AttemptSpec {
            task,
            actions: std::slice::from_ref(&action),
            latents,
            stop: true,
            interventions: &[],
        };
        let (mut results, interactions) = self.attempt(&trial, |t| t, None, budget)?;
        let result = results.pop().ok_or_else(|| Error::Failed("an attempt without a result".into()))?;
        let watched = self.events.is_active();
        let seen = result.map(|t| StepSummary::of(context.layout, &t, watched));
        Ok(self.finish_step(context, action, latents, seen, interactions))
    }

    /// The task of the episode that waits for an action, and the current latents.
    pub(super) fn ready_task(&self) -> Result<(TaskContext<'_>, Latents)> {
        let state = lock(&self.state);
        match (state.phase, state.task) {
            (Phase::Ready, Some(task)) => Ok((self.tasks.context(task), state.latents)),
            (Phase::Done, _) => Err(conflict("the episode has ended; reset the world first")),
            _ => Err(conflict("no episode has begun; reset the world first")),
        }
    }

    /// Records the outcome of an action. A valid one ends the episode if it solves the task or is the last attempt.
    pub(super) fn finish_step(
        &self,
        context: TaskContext,
        action: ValidAction,
        latents: Latents,
        mut seen: std::result::Result<StepSummary, String>,
        interactions: u64,
    ) -> StepResult {
        let task_id = context.task.id.clone();
        self.events.publish(interactions, || {
            let (task, action) = (task_id.clone(), action.values().to_vec());
            WorldEventKind::Step { task, action, outcome: outcome(&mut seen) }
        });
        match seen {
            Err(reason) => StepResult {
                observation: context.layout.observe(None),
                reward: 0.0,
                terminated: false,
                attempt: lock(&self.state).attempts,
                invalid: Some(reason),
                solved: false,
                steps: 0,
                task: task_id,
                interactions,
                collisions: 0,
                rolling_steps: 0,
                end: None,
            },
            Ok(seen) => {
                let mut state = lock(&self.state);
                state.attempts += 1;
                let attempt = state.attempts;
                let ended = seen.solved || attempt >= self.max_attempts;
                state.phase = if ended { Phase::Done } else { Phase::Ready };
                state.last = state.task.map(|task| LastStep { task, action, latents, interactions });
                drop(state);
                StepResult {
                    observation: if ended { seen.observation } else { context.layout.observe(None) },
                    reward: if seen.solved { episode_auccess(attempt, self.max_attempts) } else { 0.0 },
                    terminated: ended,
                    attempt,
                    invalid: None,
                    solved: seen.solved,
                    steps: seen.steps,
                    task: task_id,
                    interactions,
                    collisions: seen.collisions,
                    rolling_steps: seen.rolling_steps,
                    end: Some(seen.end),
                }
            }
        }
    }

    /// Indices of the tasks that a reset draws from; never empty.
    fn pool(&self, split: Option<Split>) -> Result<Arc<[usize]>> {
        let of = |split| Some(self.tasks.pool(Some(split))).filter(|pool| !pool.is_empty());
        match split {
            Some(split) => of(split).cloned().ok_or_else(|| {
                let present = Split::ALL.into_iter().filter(|s| of(*s).is_some());
                let names: Vec<String> = present.map(|s| format!("{:?}", s.name())).collect();
                let allowed = format!("{} in this world", names.join(", "));
                Error::input("split", format!("{:?}", split.name()), allowed)
            }),
            None => Ok(of(Split::Train).unwrap_or_else(|| self.tasks.pool(None)).clone()),
        }
    }
}

/// AUCCESS of an episode of at most `n` attempts that was solved at attempt `k`, both from 1: `1 - ln k / ln(n + 1)`.
///
/// Source: Bakhtin et al. 2019, section 4.1: the sum of the weights `ln(j + 1) - ln j` over the attempts `j` from `k` to `n`, over the sum
/// of all `n` weights, with `n` = 100. The mean over tasks is AUCCESS.
fn episode_auccess(k: u32, n: u32) -> f64 {
    1.0 - libm::log(f64::from(k)) / libm::log(f64::from(n) + 1.0)
}

/// The outcome as published to watchers; takes the recording out of the summary.
fn outcome(seen: &mut std::result::Result<StepSummary, String>) -> StepOutcome {
    match seen {
        Err(reason) => StepOutcome::Refused(reason.clone()),
        Ok(seen) => {
            let StepSummary { solved, steps, end, .. } = *seen;
            StepOutcome::Done { solved, steps, end, film: seen.film.take() }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::Unlimited;
    use crate::session::{Catalogue, WorldConfig, WorldKind};

    fn world(max_attempts: u32) -> World {
        let tasks = Catalogue::new().named("basketball:000").unwrap();
        World::new(WorldConfig { max_attempts, ..WorldConfig::new(tasks, WorldKind::Sim) }).unwrap()
    }

    /// The first valid actions of the task that do, or do not, solve it.
    fn actions(solve: bool, count: usize) -> Vec<Action> {
        let world = world(1);
        let space = world.tasks().tasks[0].actions().clone();
        let results = |i: usize| {
            world.reset(&Reset::default()).unwrap();
            let action = Action::Index(i as u64);
            let step = world.step(&action, None, &Unlimited).unwrap();
            (step.invalid.is_none() && step.solved == solve).then_some(action)
        };
        (0..space.count()).filter_map(results).take(count).collect()
    }

    #[test]
    fn an_episode_of_several_attempts_ends_with_success_or_the_last_attempt() {
        let (fail, solve) = (actions(false, 1).remove(0), actions(true, 1).remove(0));
        let world = world(3);
        let start = world.reset(&Reset::default()).unwrap();
        let step = |action| world.step(action, None, &Unlimited).unwrap();
        let first = step(&fail);
        assert!(!first.terminated && !first.solved && first.attempt == 1 && first.reward == 0.0);
        assert_eq!(first.observation, start.observation, "the next attempt starts where the first did");
        let second = step(&solve);
        assert!(second.terminated && second.solved && second.attempt == 2);
        assert!((second.reward - 0.5).abs() < 1e-12, "1 - ln 2 / ln 4");
        assert!(world.step(&fail, None, &Unlimited).is_err(), "the episode has ended");
        world.reset(&Reset::default()).unwrap();
        let ends: Vec<(bool, u32)> = (0..3).map(|_| step(&fail)).map(|s| (s.terminated, s.attempt)).collect();
        assert_eq!(ends, [(false, 1), (false, 2), (true, 3)]);
    }

    #[test]
    fn rewards_of_first_attempts_do_not_depend_on_the_number_of_attempts() {
        assert_eq!((episode_auccess(1, 1), episode_auccess(1, 100)), (1.0, 1.0));
        let mean = (1..=100).map(|k| episode_auccess(k, 100)).fold(f64::INFINITY, f64::min);
        assert!(mean > 0.0 && mean < 0.003, "even the last attempt counts: {mean}");
    }
}
