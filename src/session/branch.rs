//! Branching: a moment in a rollout, something else done there, and on.
//!
//! A snapshot says how its moment is reached (task, action, latents, what was done before) and nothing else; whoever goes on
//! from it comes to it by the same steps. So it is exact, it can be kept anywhere for any time, and a branch without a change
//! is the uninterrupted rollout to the bit.

use serde::{Deserialize, Serialize};

use super::action::{Action, unplaceable};
use super::attempt::Trial;
use super::intervened::{renamed, unblocked};
use super::state::{lock, refused};
use super::world::World;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::timeline::moment;
use crate::task::{Intervention, Placement, Task, ValidAction};
use crate::trajectory::{End, Trajectory};
use crate::world::{Latents, Rollout, simulate_within};

/// The value of a snapshot's `format` field.
pub const SNAPSHOT_FORMAT: &str = "iplw.snapshot/1";

/// A moment in a rollout, by how it is reached.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    /// Always [`SNAPSHOT_FORMAT`].
    pub format: String,
    /// Id of the world.
    pub world: String,
    /// Id of the task.
    pub task: String,
    /// Each number from 0 to 1.
    pub action: Vec<f64>,
    /// Those of the rollout, whatever is set later.
    pub latents: Latents,
    /// Whether the rollout ends when the goal is reached.
    pub stop: bool,
    /// What was done up to the moment.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub interventions: Vec<Intervention>,
    /// s since the start
    pub at: f64,
    /// The same in time steps.
    pub step: u32,
}

/// The moment of which a snapshot is to be made.
pub struct Asked {
    /// The last step's, with its latents, if absent.
    pub action: Option<Action>,
    /// Id of the task; the current one if absent.
    pub task: Option<String>,
    pub stop: bool,
    /// What is done on the way; not after the moment.
    pub interventions: Vec<Intervention>,
    /// s since the start; the nearest time step.
    pub at: f64,
}

/// What became of a branch.
pub struct Branched {
    pub engine: &'static str,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// From the start of the rollout.
    pub trajectory: Trajectory,
}

impl World {
    /// A snapshot, and the rollout up to it: its last sample is the state there, as the world's sensors show it.
    pub fn snapshot(&self, id: &str, asked: Asked, budget: &dyn Budget) -> Result<(Snapshot, Trajectory)> {
        self.branches()?;
        let (task, latents, action) = self.to_branch(&asked)?;
        let step = moment(&task.scene, asked.at)?;
        let at = f64::from(step) * task.scene.time_step;
        for (k, own) in asked.interventions.iter().enumerate() {
            let field = format!("interventions[{k}].at");
            if moment(&task.scene, own.at()).map_err(|e| e.under(&format!("interventions[{k}]")))? > step {
                return Err(Error::input(field, own.at(), format!("a moment up to the snapshot's, {at} s")));
            }
        }
        let lists = std::slice::from_ref(&asked.interventions);
        self.intervened(&task.scene, lists, 1, latents, true, budget).map_err(|e| renumbered(e, 0))?;
        let snapshot = Snapshot {
            format: SNAPSHOT_FORMAT.into(),
            world: id.into(),
            task: task.id.clone(),
            action: action.values().to_vec(),
            latents,
            stop: asked.stop,
            interventions: asked.interventions,
            at,
            step,
        };
        let trajectory = self.up_to(task, &action, &snapshot, budget)?;
        Ok((snapshot, trajectory))
    }

    /// Goes on from a snapshot with other things done there or later.
    pub fn branch(
        &self,
        id: &str,
        snapshot: &Snapshot,
        changes: Vec<Intervention>,
        budget: &dyn Budget,
    ) -> Result<Branched> {
        self.branches()?;
        if snapshot.format != SNAPSHOT_FORMAT {
            let (value, allowed) = (format!("{:?}", snapshot.format), format!("{SNAPSHOT_FORMAT:?}"));
            return Err(Error::input("snapshot.format", value, allowed));
        }
        if snapshot.world != id {
            let allowed = format!("{id:?}: a snapshot is gone on from in the world that it was made in");
            return Err(Error::input("snapshot.world", format!("{:?}", snapshot.world), allowed));
        }
        snapshot.latents.validate().map_err(|e| e.under("snapshot"))?;
        let (task, _) = self.task_or_current(Some(&snapshot.task))?;
        let action = Action::Vector(snapshot.action.clone()).resolve(task.actions(), "snapshot.action")?;
        let step = moment(&task.scene, snapshot.at).map_err(|e| e.under("snapshot"))?;
        let before = snapshot.interventions.len();
        for (k, own) in changes.iter().enumerate() {
            if moment(&task.scene, own.at()).map_err(|e| e.under(&format!("interventions[{k}]")))? < step {
                let allowed = format!("a moment from the snapshot's on, {} s", snapshot.at);
                return Err(Error::input(format!("interventions[{k}].at"), own.at(), allowed));
            }
        }
        let all = [snapshot.interventions.clone(), changes].concat();
        let lists = std::slice::from_ref(&all);
        let numbered = |e| renumbered(e, before);
        self.intervened(&task.scene, lists, 1, snapshot.latents, true, budget).map_err(numbered)?;
        let actions = [action];
        let trial = Trial {
            task,
            actions: &actions,
            latents: snapshot.latents,
            stop: snapshot.stop,
            interventions: lists,
        };
        let (mut results, interactions) = self.attempt(&trial, |t| t, None, budget).map_err(numbered)?;
        self.tell_attempts(&trial, &results, interactions);
        let engine = self.engine_for(task, &actions, lists);
        match results.pop() {
            Some(Ok(trajectory)) => Ok(Branched { engine, interactions, trajectory }),
            Some(Err(reason)) => Err(in_the_way(&reason)),
            None => Err(Error::Failed("an attempt without a result".into())),
        }
    }

    /// Task, latents and action of the rollout that is asked for.
    fn to_branch(&self, asked: &Asked) -> Result<(&Task, Latents, ValidAction)> {
        if let Some(action) = &asked.action {
            let (task, latents) = self.task_or_current(asked.task.as_deref())?;
            return Ok((task, latents, action.resolve(task.actions(), "action")?));
        }
        let none = "no step has been made; step the world first, or name the `action`";
        let made = lock(&self.state).last.clone().ok_or_else(|| refused(none))?;
        let own = &self.tasks.tasks[made.task].id;
        if let Some(other) = asked.task.as_ref().filter(|task| *task != own) {
            let allowed = format!("{own:?}, the last step's, or an `action` beside it");
            return Err(Error::input("task", format!("{other:?}"), allowed));
        }
        Ok((&self.tasks.tasks[made.task], made.latents, made.action))
    }

    /// A rollout up to a snapshot.
    fn up_to(
        &self,
        task: &Task,
        action: &ValidAction,
        snapshot: &Snapshot,
        budget: &dyn Budget,
    ) -> Result<Trajectory> {
        let mut scene = match task.place(action) {
            Placement::Valid(scene) => scene,
            Placement::Invalid(reason) => {
                return Err(unplaceable(&Action::Vector(snapshot.action.clone()), &reason));
            }
        };
        let before =
            |own: &&Intervention| moment(&task.scene, own.at()).is_ok_and(|step| step < snapshot.step);
        scene.interventions = snapshot.interventions.iter().filter(before).cloned().collect();
        scene.steps = snapshot.step.max(1);
        let (latents, stop) = (snapshot.latents, snapshot.stop);
        let rollout = Rollout { latents, effects: &self.effects, stop, ..Rollout::of(&scene) };
        let done = simulate_within(budget, &[rollout], self.engine, |_, t| t)?.pop().ok_or_else(lost)?;
        let mut done = unblocked(&scene, done).map_err(|reason| in_the_way(&reason))?;
        if snapshot.step == 0 {
            // The one step was for an engine to make the start's states.
            done.times.truncate(1);
            done.bodies.iter_mut().for_each(|track| track.truncate(1));
            return Ok(done);
        }
        let ended = done.outcome.steps;
        if ended < scene.steps || done.outcome.end == End::Goal {
            let last = f64::from(ended) * scene.time_step;
            let allowed = format!("a moment before {last} s, when this rollout ends by itself");
            return Err(Error::input("at", snapshot.at, allowed));
        }
        Ok(done)
    }
}

fn in_the_way(reason: &str) -> Error {
    Error::input("interventions", reason, "changes that put things where nothing else is then")
}

/// The error about `interventions[0][k]` as one about those of a branch, before which a snapshot has `before`.
fn renumbered(error: Error, before: usize) -> Error {
    renamed(error, |field| {
        let rest = field.strip_prefix("interventions[0]")?;
        let Some((number, rest)) = rest.strip_prefix('[').and_then(|r| r.split_once(']')) else {
            return Some(format!("interventions{rest}"));
        };
        let number: usize = number.parse().ok()?;
        match number.checked_sub(before) {
            Some(own) => Some(format!("interventions[{own}]{rest}")),
            None => Some(format!("snapshot.interventions[{number}]{rest}")),
        }
    })
}

fn lost() -> Error {
    Error::Failed("a rollout was lost".into())
}
