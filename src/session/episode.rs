//! Episodes: reset and step.

use std::sync::Arc;

use rand::RngExt;

use super::action::Action;
use super::attempt::Trial;
use super::catalogue::Posed;
use super::observation::Layout;
use super::state::{Made, Phase, lock, refused};
use super::watch::{Brought, Film, What};
use super::world::World;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::rng;
use crate::task::{Split, ValidAction};
use crate::trajectory::{End, Trajectory};
use crate::world::Latents;

/// What to reset to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reset {
    /// Starts the world's stream of tasks anew.
    pub seed: Option<u64>,
    /// Id of the task; drawn from the stream if absent.
    pub task: Option<String>,
    /// Part of the family to draw from; train, or all tasks if the world has none there.
    pub split: Option<Split>,
}

/// The start of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// (n_features,) in [0, 1].
    pub observation: Vec<f64>,
    pub task: String,
    pub split: Split,
}

/// What a step brought: Gymnasium's tuple (never truncated) and what else there is to know.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// (n_features,) in [0, 1], of the final state.
    pub observation: Vec<f64>,
    /// 1 if solved, else 0.
    pub reward: f64,
    pub terminated: bool,
    /// Why the action could not be placed, if so.
    pub invalid: Option<String>,
    pub solved: bool,
    /// Simulated time steps.
    pub steps: u32,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    pub collisions: u32,
    pub rolling_steps: u32,
    pub end: Option<End>,
}

/// What a reset draws its task from.
pub(super) enum Drawn {
    /// This one.
    Given(usize),
    /// Any of these; never empty.
    Pool(Arc<[usize]>),
}

/// What is left of a trajectory once a step is made of it.
pub(super) struct Seen {
    observation: Vec<f64>,
    solved: bool,
    steps: u32,
    collisions: u32,
    rolling_steps: u32,
    end: End,
    /// For those who watch, if anybody does.
    film: Option<Film>,
}

impl Seen {
    pub(super) fn of(layout: &Layout, trajectory: &Trajectory, watched: bool) -> Seen {
        Seen {
            observation: layout.observe(Some(trajectory)),
            solved: trajectory.solved(),
            steps: trajectory.outcome.steps,
            collisions: trajectory.collisions,
            rolling_steps: trajectory.rolling_steps,
            end: trajectory.outcome.end,
            film: watched.then(|| Film::of(trajectory)),
        }
    }
}

impl World {
    /// Starts an episode.
    pub fn reset(&self, reset: &Reset) -> Result<Start> {
        let drawn = self.drawn(reset)?;
        let _turn = lock(&self.turn);
        Ok(self.begin(drawn, reset))
    }

    /// What a reset draws its task from.
    pub(super) fn drawn(&self, reset: &Reset) -> Result<Drawn> {
        let given = reset.task.as_deref().map(|id| self.tasks.find(id)).transpose()?;
        let pool = self.pool(reset.split)?;
        match (given, reset.split) {
            (Some(task), Some(split)) if !pool.contains(&task) => {
                let own = self.tasks.tasks[task].split.name();
                let allowed = format!("{own:?}, where the task is");
                Err(Error::input("split", format!("{:?}", split.name()), allowed))
            }
            (Some(task), _) => Ok(Drawn::Given(task)),
            (None, _) => Ok(Drawn::Pool(pool)),
        }
    }

    /// Starts an episode; the caller has the turn.
    pub(super) fn begin(&self, drawn: Drawn, reset: &Reset) -> Start {
        let mut state = lock(&self.state);
        if let Some(seed) = reset.seed {
            state.resets = rng::stream(seed, "reset");
        }
        let index = match drawn {
            Drawn::Given(task) => task,
            Drawn::Pool(pool) => pool[state.resets.random_range(0..pool.len())],
        };
        state.task = Some(index);
        state.split = reset.split;
        state.phase = Phase::Ready;
        state.episodes += 1;
        let interactions = state.interactions;
        drop(state);
        let Posed { task, layout } = self.tasks.posed(index);
        let reset = || What::Reset { task: task.id.clone(), split: task.split };
        self.lookout.tell(interactions, reset);
        Start { observation: layout.observe(None), task: task.id.clone(), split: task.split }
    }

    /// Carries out one action; see the table of phases.
    pub fn step(&self, action: &Action, budget: &dyn Budget) -> Result<Step> {
        let _turn = lock(&self.turn);
        let (posed, latents) = self.ready()?;
        let task = posed.task;
        let action = action.resolve(task.actions(), "action")?;
        let trial =
            Trial { task, actions: std::slice::from_ref(&action), latents, stop: true, interventions: &[] };
        let (mut results, interactions) = self.attempt(&trial, |t| t, None, budget)?;
        let result = results.pop().ok_or_else(|| Error::Failed("an attempt without a result".into()))?;
        let watched = self.lookout.is_on();
        let seen = result.map(|t| Seen::of(posed.layout, &t, watched));
        Ok(self.stepped(posed, action, latents, seen, interactions))
    }

    /// The task of the episode that waits for an action, and the latents it is attempted with.
    pub(super) fn ready(&self) -> Result<(Posed<'_>, Latents)> {
        let state = lock(&self.state);
        match (state.phase, state.task) {
            (Phase::Ready, Some(task)) => Ok((self.tasks.posed(task), state.latents)),
            (Phase::Done, _) => Err(refused("the episode has ended; reset the world first")),
            _ => Err(refused("no episode has begun; reset the world first")),
        }
    }

    /// Takes in what an action brought; a valid one ends the episode.
    pub(super) fn stepped(
        &self,
        posed: Posed,
        action: ValidAction,
        latents: Latents,
        mut seen: std::result::Result<Seen, String>,
        interactions: u64,
    ) -> Step {
        let task_id = posed.task.id.clone();
        self.lookout.tell(interactions, || {
            let (task, action) = (task_id.clone(), action.values().to_vec());
            What::Step { task, action, brought: brought(&mut seen) }
        });
        match seen {
            Err(reason) => Step {
                observation: posed.layout.observe(None),
                reward: 0.0,
                terminated: false,
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
                state.phase = Phase::Done;
                state.last = state.task.map(|task| Made { task, action, latents, interactions });
                drop(state);
                Step {
                    observation: seen.observation,
                    reward: f64::from(u8::from(seen.solved)),
                    terminated: true,
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

    /// Indices of the tasks a reset draws from; never empty.
    fn pool(&self, split: Option<Split>) -> Result<Arc<[usize]>> {
        let of = |split| Some(self.tasks.pool(Some(split))).filter(|pool| !pool.is_empty());
        match split {
            Some(split) => of(split).cloned().ok_or_else(|| {
                let there: Vec<String> = [Split::Train, Split::Validation, Split::Test]
                    .into_iter()
                    .filter(|s| of(*s).is_some())
                    .map(|s| format!("{:?}", s.name()))
                    .collect();
                Error::input(
                    "split",
                    format!("{:?}", split.name()),
                    format!("{} in this world", there.join(", ")),
                )
            }),
            None => Ok(of(Split::Train).unwrap_or_else(|| self.tasks.pool(None)).clone()),
        }
    }
}

/// What those who watch are told of it.
fn brought(seen: &mut std::result::Result<Seen, String>) -> Brought {
    match seen {
        Err(reason) => Brought::Refused(reason.clone()),
        Ok(seen) => {
            let Seen { solved, steps, end, .. } = *seen;
            Brought::Done { solved, steps, end, film: seen.film.take() }
        }
    }
}
