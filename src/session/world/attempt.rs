//! Attempts: simulates or measures actions in a world and counts the valid ones.

use std::sync::Mutex;

use super::World;
use super::interventions::{apply_interventions, interventions_of, reject_blocked, with_list_index};
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::reality::{HiddenWorld, Reality};
use crate::session::action::Action;
use crate::session::config::WorldKind;
use crate::session::watch::{Recording, WorldEventKind};
use crate::sync::lock;
use crate::task::{Intervention, Placement, Task, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Latents, Rollout, Simulator, select_engine};

/// A batch of rollouts outside any episode.
#[derive(Clone, Debug, PartialEq)]
pub struct RolloutRequest {
    pub actions: Vec<Action>,
    /// Id of the task; the current one if absent.
    pub task: Option<String>,
    /// Whether results carry samples.
    pub trajectories: bool,
    /// Whether a rollout ends when the goal is reached; real worlds always do.
    pub stop: bool,
    /// Interventions during the rollouts: empty, one list for all actions, or one list per action. Simulated worlds only.
    pub interventions: Vec<Vec<Intervention>>,
}

/// The results of a batch of rollouts.
pub struct RolloutResults {
    /// Name of the engine that ran.
    pub engine: &'static str,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// Valid attempts among the results.
    pub valid: u64,
    /// In the order of the actions; trajectories carry samples only on request.
    pub results: Vec<AttemptResult>,
}

impl RolloutResults {
    /// Total simulated time steps.
    pub fn steps(&self) -> u64 {
        self.results.iter().flatten().map(|t| u64::from(t.outcome.steps)).sum()
    }
}

/// Outcome of one action: a trajectory, or why it could not be placed.
pub type AttemptResult = std::result::Result<Trajectory, String>;

/// Actions to attempt, with their physics.
pub(super) struct AttemptSpec<'a> {
    pub task: &'a Task,
    pub actions: &'a [ValidAction],
    pub latents: Latents,
    /// Whether a rollout ends when the goal is reached.
    pub stop: bool,
    /// Same layout as in [`RolloutRequest`].
    pub interventions: &'a [Vec<Intervention>],
}

/// Persists the results and the world's updated counter in one transaction.
pub type PersistResults<'a> = &'a dyn Fn(&[AttemptResult], u64) -> Result<()>;

impl World {
    /// Attempts many actions on a task without changing the current episode.
    pub fn rollout(&self, batch: &RolloutRequest, budget: &dyn Budget) -> Result<RolloutResults> {
        let (task, latents) = self.task_or_current(batch.task.as_deref())?;
        self.limits.check_count("actions", batch.actions.len())?;
        if self.kind == WorldKind::Real && !batch.stop {
            return Err(Error::input("stop", false, "true: a real world ends with its goal"));
        }
        let actions: Vec<ValidAction> = batch
            .actions
            .iter()
            .enumerate()
            .map(|(i, a)| a.resolve(task.actions(), &format!("actions[{i}]")))
            .collect::<Result<_>>()?;
        // A real world holds all samples in memory while it measures.
        let kept = batch.trajectories || self.kind == WorldKind::Real;
        self.check_interventions(&task.scene, &batch.interventions, actions.len(), latents, kept, budget)?;
        let keep = |mut t: Trajectory| {
            if !batch.trajectories {
                (t.times, t.bodies, t.events) = Default::default();
            }
            t
        };
        let interventions = &batch.interventions;
        let trial = AttemptSpec { task, actions: &actions, latents, stop: batch.stop, interventions };
        let (results, interactions) = self.attempt(&trial, keep, None, budget)?;
        self.publish_attempts(&trial, &results, interactions);
        Ok(RolloutResults {
            engine: self.engine_for(task, &actions, interventions),
            task: task.id.clone(),
            interactions,
            valid: results.iter().filter(|r| r.is_ok()).count() as u64,
            results,
        })
    }

    /// Attempts actions and counts the valid ones. `store` persists results and counter atomically before anybody sees
    /// them; if it fails, no results are returned.
    pub fn attempts(
        &self,
        task: &Task,
        actions: &[ValidAction],
        store: Option<PersistResults>,
        budget: &dyn Budget,
    ) -> Result<Vec<AttemptResult>> {
        let latents = lock(&self.state).latents;
        let trial = AttemptSpec { task, actions, latents, stop: true, interventions: &[] };
        let (results, interactions) = self.attempt(&trial, |t| t, store, budget)?;
        self.events.publish(interactions, || attempts(task, &results, None));
        Ok(results)
    }

    /// Publishes attempts made outside the episode, with a recording of the last one that carries samples.
    pub(super) fn publish_attempts(&self, trial: &AttemptSpec, results: &[AttemptResult], interactions: u64) {
        self.events.publish(interactions, || {
            let mut done = trial.actions.iter().zip(results).filter_map(|(a, r)| Some((a, r.as_ref().ok()?)));
            // A recording shows the task's own bodies throughout; interventions may add or remove bodies.
            let last = done.rfind(|(_, t)| !t.times.is_empty() && trial.interventions.is_empty());
            attempts(trial.task, results, last.map(|(a, t)| (a.values().to_vec(), Recording::of(t))))
        });
    }

    /// Returns the results in the order of the actions, and the world's counter afterwards.
    pub(super) fn attempt(
        &self,
        trial: &AttemptSpec,
        keep: impl Fn(Trajectory) -> Trajectory + Sync,
        store: Option<PersistResults>,
        budget: &dyn Budget,
    ) -> Result<(Vec<AttemptResult>, u64)> {
        let AttemptSpec { task, actions, latents, stop, interventions } = *trial;
        if let Some(hidden) = &self.hidden {
            return self.measured(hidden, trial, keep, store, budget);
        }
        let place = |a| budget.check().map(|()| task.place(a));
        let mut placements: Vec<Placement> = actions.iter().map(place).collect::<Result<_>>()?;
        apply_interventions(&mut placements, interventions);
        let rollouts: Vec<Rollout> = placements
            .iter()
            .filter_map(|p| match p {
                Placement::Valid(scene) => Some(Rollout {
                    latents,
                    effects: &self.effects,
                    stop_at_goal: stop,
                    ..Rollout::of(scene)
                }),
                Placement::Invalid(_) => None,
            })
            .collect();
        let simulated = Simulator::new(self.engine).budget(budget).map(&rollouts, |_, t| keep(t));
        let mut simulated = simulated
            .map_err(|e| if interventions.len() == 1 { with_list_index(e, 0) } else { e })?
            .into_iter();
        let results: Vec<AttemptResult> = placements
            .iter()
            .map(|p| match p {
                Placement::Invalid(reason) => Err(reason.clone()),
                Placement::Valid(scene) => simulated
                    .next()
                    .ok_or_else(|| "nothing was simulated".into())
                    .and_then(|t| reject_blocked(scene, t)),
            })
            .collect();
        let interactions = self.count_simulated(results.iter().flatten().count() as u64);
        if let Some(store) = store {
            store(&results, interactions)?;
        }
        Ok((results, interactions))
    }

    /// Attempts a single action and publishes it; returns the result and the world's counter afterwards.
    pub(super) fn attempt_one(
        &self,
        trial: &AttemptSpec,
        budget: &dyn Budget,
    ) -> Result<(AttemptResult, u64)> {
        let (mut results, interactions) = self.attempt(trial, |t| t, None, budget)?;
        self.publish_attempts(trial, &results, interactions);
        let result = results.pop().ok_or_else(|| Error::Failed("an attempt without a result".into()))?;
        Ok((result, interactions))
    }

    /// Counts valid attempts in a simulated world; returns the counter.
    pub(super) fn count_simulated(&self, attempts: u64) -> u64 {
        let interactions = {
            let mut state = lock(&self.state);
            state.interactions += attempts;
            state.interactions
        };
        if let Some(account) = &self.account {
            account.store.note_world(&account.id, interactions);
        }
        interactions
    }

    /// [`World::attempt`] for a real world.
    fn measured(
        &self,
        hidden: &Mutex<HiddenWorld>,
        trial: &AttemptSpec,
        keep: impl Fn(Trajectory) -> Trajectory + Sync,
        store: Option<PersistResults>,
        budget: &dyn Budget,
    ) -> Result<(Vec<AttemptResult>, u64)> {
        let mut hidden = lock(hidden);
        let before = hidden.interactions();
        let measured = hidden.measure_within(budget, trial.task, trial.actions);
        let made = hidden.interactions() - before;
        let interactions = self.count_measured(made);
        let attempts = match measured {
            Ok(attempts) => attempts,
            Err(e) => {
                drop(hidden);
                // An interrupted measurement returns nothing but still counts.
                if let Some(account) = self.account.as_ref().filter(|_| made > 0) {
                    account.store.count_world(&account.id, interactions)?;
                }
                return Err(e);
            }
        };
        let results = attempts.into_iter().map(|a| match (a.placement, a.trajectory) {
            (Err(reason), _) => Err(reason),
            (Ok(_), Some(trajectory)) => Ok(keep(trajectory)),
            (Ok(_), None) => Err("nothing was observed".into()),
        });
        let results: Vec<AttemptResult> = results.collect();
        match store {
            // The world stays locked so that the stored counter matches the stored results.
            Some(store) => {
                self.write_original()?;
                store(&results, interactions)?;
            }
            None => {
                drop(hidden);
                if let Some(account) = &self.account {
                    account.store.count_world(&account.id, interactions)?;
                }
            }
        }
        Ok((results, interactions))
    }

    /// Name of the engine that simulates the first action that can be placed.
    pub(super) fn engine_for(
        &self,
        task: &Task,
        actions: &[ValidAction],
        interventions: &[Vec<Intervention>],
    ) -> &'static str {
        let placed = actions.iter().enumerate().find_map(|(i, a)| match task.place(a) {
            Placement::Valid(mut scene) => {
                scene.interventions = interventions_of(interventions, i).to_vec();
                Some(scene)
            }
            Placement::Invalid(_) => None,
        });
        let engine = placed.and_then(|scene| {
            let rollout = Rollout { effects: &self.effects, ..Rollout::of(&scene) };
            select_engine(self.engine, &rollout).ok()
        });
        engine.unwrap_or(self.engine).name()
    }
}

/// The event for a batch of attempts. A job's recordings are private to its owner, so they pass `film: None`.
fn attempts(task: &Task, results: &[AttemptResult], film: Option<(Vec<f64>, Recording)>) -> WorldEventKind {
    let valid = || results.iter().flatten();
    WorldEventKind::Attempts {
        task: task.id.clone(),
        tried: results.len() as u64,
        valid: valid().count() as u64,
        solved: valid().filter(|t| t.solved()).count() as u64,
        film,
    }
}
