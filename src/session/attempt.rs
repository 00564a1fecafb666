//! Attempts: actions in a world's physics, counted.

use std::sync::Mutex;

use super::action::Action;
use super::config::Kind;
use super::intervened::{intervene, of_action, of_list, unblocked};
use super::state::lock;
use super::watch::{Film, What};
use super::world::World;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::reality::{HiddenWorld, Reality};
use crate::task::{Intervention, Placement, Task, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Latents, Rollout, chosen, simulate_within};

/// A batch of attempts outside any episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    pub actions: Vec<Action>,
    /// Id of the task; the current one if absent.
    pub task: Option<String>,
    /// Whether results carry samples.
    pub trajectories: bool,
    /// Whether a rollout ends when the goal is reached; real worlds always do.
    pub stop: bool,
    /// What is done in the middle of rollouts: nothing if empty, else a list for each action, or one for all of them. Not in a
    /// real world.
    pub interventions: Vec<Vec<Intervention>>,
}

/// What a batch brought.
pub struct Rolled {
    /// Name of the engine that ran.
    pub engine: &'static str,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// Valid attempts among the results.
    pub valid: u64,
    /// In the order of the actions: a trajectory (without samples unless asked for), or why not.
    pub results: Vec<Tried>,
}

impl Rolled {
    /// Time steps of all its attempts.
    pub fn steps(&self) -> u64 {
        self.results.iter().flatten().map(|t| u64::from(t.outcome.steps)).sum()
    }
}

/// What became of an action: a trajectory, or why it could not be placed.
pub type Tried = std::result::Result<Trajectory, String>;

/// What is attempted, and how.
pub(super) struct Trial<'a> {
    pub task: &'a Task,
    pub actions: &'a [ValidAction],
    pub latents: Latents,
    /// Whether a rollout ends when the goal is reached.
    pub stop: bool,
    /// As [`Batch`] has them.
    pub interventions: &'a [Vec<Intervention>],
}

/// Keeps results together with the world's counter after them.
pub type Keep<'a> = &'a dyn Fn(&[Tried], u64) -> Result<()>;

impl World {
    /// Attempts many actions on a task, leaving the episode as it is.
    pub fn rollout(&self, batch: &Batch, budget: &dyn Budget) -> Result<Rolled> {
        let (task, latents) = self.task_or_current(batch.task.as_deref())?;
        self.limits.countable("actions", batch.actions.len())?;
        if self.kind == Kind::Real && !batch.stop {
            return Err(Error::input("stop", false, "true: a real world ends with its goal"));
        }
        let actions: Vec<ValidAction> = batch
            .actions
            .iter()
            .enumerate()
            .map(|(i, a)| a.resolve(task.actions(), &format!("actions[{i}]")))
            .collect::<Result<_>>()?;
        // A real world keeps all samples while it measures.
        let kept = batch.trajectories || self.kind == Kind::Real;
        self.intervened(&task.scene, &batch.interventions, actions.len(), latents, kept, budget)?;
        let keep = |mut t: Trajectory| {
            if !batch.trajectories {
                (t.times, t.bodies, t.events) = Default::default();
            }
            t
        };
        let interventions = &batch.interventions;
        let trial = Trial { task, actions: &actions, latents, stop: batch.stop, interventions };
        let (results, interactions) = self.attempt(&trial, keep, None, budget)?;
        self.tell_attempts(&trial, &results, interactions);
        Ok(Rolled {
            engine: self.engine_for(task, &actions, interventions),
            task: task.id.clone(),
            interactions,
            valid: results.iter().filter(|r| r.is_ok()).count() as u64,
            results,
        })
    }

    /// Attempts actions in this world's physics and counts the valid ones. `store` is given the results and the
    /// counter before anybody else is, and keeps both or neither; what it cannot keep is not given out.
    pub fn attempts(
        &self,
        task: &Task,
        actions: &[ValidAction],
        store: Option<Keep>,
        budget: &dyn Budget,
    ) -> Result<Vec<Tried>> {
        let latents = lock(&self.state).latents;
        let trial = Trial { task, actions, latents, stop: true, interventions: &[] };
        let (results, interactions) = self.attempt(&trial, |t| t, store, budget)?;
        self.lookout.tell(interactions, || attempts(task, &results, None));
        Ok(results)
    }

    /// Tells of actions that were tried outside the episode, with the film of the last one whose samples were asked for.
    pub(super) fn tell_attempts(&self, trial: &Trial, results: &[Tried], interactions: u64) {
        self.lookout.tell(interactions, || {
            let mut done = trial.actions.iter().zip(results).filter_map(|(a, r)| Some((a, r.as_ref().ok()?)));
            // A film has the task's own bodies, all of the time.
            let last = done.rfind(|(_, t)| !t.times.is_empty() && trial.interventions.is_empty());
            attempts(trial.task, results, last.map(|(a, t)| (a.values().to_vec(), Film::of(t))))
        });
    }

    /// Results in the order of the actions, and the count of valid attempts after them.
    pub(super) fn attempt(
        &self,
        trial: &Trial,
        keep: impl Fn(Trajectory) -> Trajectory + Sync,
        store: Option<Keep>,
        budget: &dyn Budget,
    ) -> Result<(Vec<Tried>, u64)> {
        let Trial { task, actions, latents, stop, interventions } = *trial;
        if let Some(hidden) = &self.hidden {
            return self.measured(hidden, trial, keep, store, budget);
        }
        let place = |a| budget.look().map(|()| task.place(a));
        let mut placements: Vec<Placement> = actions.iter().map(place).collect::<Result<_>>()?;
        intervene(&mut placements, interventions);
        let rollouts: Vec<Rollout> = placements
            .iter()
            .filter_map(|p| match p {
                Placement::Valid(scene) => {
                    Some(Rollout { latents, effects: &self.effects, stop, ..Rollout::of(scene) })
                }
                Placement::Invalid(_) => None,
            })
            .collect();
        let simulated = simulate_within(budget, &rollouts, self.engine, |_, t| keep(t));
        let mut simulated =
            simulated.map_err(|e| if interventions.len() == 1 { of_list(e, 0) } else { e })?.into_iter();
        let results: Vec<Tried> = placements
            .iter()
            .map(|p| match p {
                Placement::Invalid(reason) => Err(reason.clone()),
                Placement::Valid(scene) => simulated
                    .next()
                    .ok_or_else(|| "nothing was simulated".into())
                    .and_then(|t| unblocked(scene, t)),
            })
            .collect();
        let interactions = {
            let mut state = lock(&self.state);
            state.interactions += results.iter().flatten().count() as u64;
            state.interactions
        };
        if let Some(account) = &self.account {
            account.store.note_world(&account.id, interactions, None);
        }
        if let Some(store) = store {
            store(&results, interactions)?;
        }
        Ok((results, interactions))
    }

    /// [`World::attempt`] in a real world.
    fn measured(
        &self,
        hidden: &Mutex<HiddenWorld>,
        trial: &Trial,
        keep: impl Fn(Trajectory) -> Trajectory + Sync,
        store: Option<Keep>,
        budget: &dyn Budget,
    ) -> Result<(Vec<Tried>, u64)> {
        let mut hidden = lock(hidden);
        let before = hidden.interactions();
        let measured = hidden.measure_within(budget, trial.task, trial.actions);
        let interactions = hidden.interactions();
        lock(&self.state).interactions = interactions;
        let attempts = match measured {
            Ok(attempts) => attempts,
            Err(e) => {
                drop(hidden);
                // Stopped in the middle: nobody sees what came of it, and it counts.
                if let Some(account) = self.account.as_ref().filter(|_| interactions > before) {
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
        let results: Vec<Tried> = results.collect();
        match store {
            // The world stays locked, so that what is counted is what is kept.
            Some(store) => store(&results, interactions)?,
            None => {
                drop(hidden);
                if let Some(account) = &self.account {
                    account.store.count_world(&account.id, interactions)?;
                }
            }
        }
        Ok((results, interactions))
    }

    /// Name of the engine that runs the first placeable of the actions.
    pub(super) fn engine_for(
        &self,
        task: &Task,
        actions: &[ValidAction],
        interventions: &[Vec<Intervention>],
    ) -> &'static str {
        let placed = actions.iter().enumerate().find_map(|(i, a)| match task.place(a) {
            Placement::Valid(mut scene) => {
                scene.interventions = of_action(interventions, i).to_vec();
                Some(scene)
            }
            Placement::Invalid(_) => None,
        });
        let engine = placed.and_then(|scene| {
            let rollout = Rollout { effects: &self.effects, ..Rollout::of(&scene) };
            chosen(self.engine, &rollout).ok()
        });
        engine.unwrap_or(self.engine).name()
    }
}

/// What is told of attempts: a job's belong to its owner, and their films too.
fn attempts(task: &Task, results: &[Tried], film: Option<(Vec<f64>, Film)>) -> What {
    let valid = || results.iter().flatten();
    What::Attempts {
        task: task.id.clone(),
        tried: results.len() as u64,
        valid: valid().count() as u64,
        solved: valid().filter(|t| t.solved()).count() as u64,
        film,
    }
}
