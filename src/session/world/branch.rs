//! Branching: counterfactual rollouts that intervene at a given moment.
//!
//! A snapshot stores how its moment is reached (task, action, latents, earlier interventions), not the state itself. A branch
//! replays the same steps, so a snapshot is exact, can be stored anywhere, and a branch without changes is bit-identical to the
//! uninterrupted rollout.

use serde::{Deserialize, Serialize};

use super::World;
use super::attempt::AttemptSpec;
use super::interventions::{reject_blocked, with_field};
use crate::budget::Budget;
use crate::error::{Error, Result, check_format};
use crate::session::action::{Action, unplaceable};
use crate::session::state::conflict;
use crate::sync::lock;
use crate::task::timeline::step_at;
use crate::task::{Intervention, Placement, Task, ValidAction};
use crate::trajectory::{Termination, Trajectory};
use crate::world::{Latents, Rollout, Simulator};

/// The value of a snapshot's `format` field.
pub const SNAPSHOT_FORMAT: &str = "iplw.snapshot/1";

/// A moment in a rollout, stored as the recipe that reaches it.
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
    /// Latents of the rollout; later changes of the world's latents do not affect it.
    pub latents: Latents,
    /// Whether the rollout ends when the goal is reached.
    pub stop: bool,
    /// Interventions up to the moment.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub interventions: Vec<Intervention>,
    /// s since the start
    pub at: f64,
    /// The same moment in time steps.
    pub step: u32,
}

/// The moment to take a snapshot of.
pub struct SnapshotRequest {
    /// Default: the action of the last step, with its latents.
    pub action: Option<Action>,
    /// Id of the task; the current one if absent.
    pub task: Option<String>,
    pub stop: bool,
    /// Interventions up to the moment, none later.
    pub interventions: Vec<Intervention>,
    /// s since the start, rounded to the nearest time step.
    pub at: f64,
}

/// The result of a branch.
pub struct BranchResult {
    pub engine: &'static str,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// From the start of the rollout.
    pub trajectory: Trajectory,
}

impl World {
    /// Takes a snapshot. The returned trajectory ends there; its last sample is the state as the world's sensors observe it.
    pub fn snapshot(
        &self,
        id: &str,
        asked: SnapshotRequest,
        budget: &dyn Budget,
    ) -> Result<(Snapshot, Trajectory)> {
        self.check_branchable()?;
        let (task, latents, action) = self.resolve_request(&asked)?;
        let step = step_at(&task.scene, asked.at)?;
        let at = f64::from(step) * task.scene.time_step;
        for (k, own) in asked.interventions.iter().enumerate() {
            let field = format!("interventions[{k}].at");
            if step_at(&task.scene, own.at()).map_err(|e| e.in_field(&format!("interventions[{k}]")))? > step
            {
                return Err(Error::input(field, own.at(), format!("a time up to the snapshot's, {at} s")));
            }
        }
        let lists = std::slice::from_ref(&asked.interventions);
        self.check_interventions(&task.scene, lists, 1, latents, true, budget)
            .map_err(|e| with_branch_index(e, 0))?;
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
        let trajectory = self.simulate_to(task, &action, &snapshot, budget)?;
        Ok((snapshot, trajectory))
    }

    /// Continues from a snapshot with interventions at or after its moment.
    pub fn branch(
        &self,
        id: &str,
        snapshot: &Snapshot,
        changes: Vec<Intervention>,
        budget: &dyn Budget,
    ) -> Result<BranchResult> {
        self.check_branchable()?;
        check_format(&snapshot.format, SNAPSHOT_FORMAT).map_err(|e| e.in_field("snapshot"))?;
        if snapshot.world != id {
            let allowed = format!("{id:?}: a snapshot can only be branched in the world it was taken in");
            return Err(Error::input("snapshot.world", format!("{:?}", snapshot.world), allowed));
        }
        snapshot.latents.validate().map_err(|e| e.in_field("snapshot"))?;
        let (task, _) = self.task_or_current(Some(&snapshot.task))?;
        let action = Action::Vector(snapshot.action.clone()).resolve(task.actions(), "snapshot.action")?;
        let step = step_at(&task.scene, snapshot.at).map_err(|e| e.in_field("snapshot"))?;
        let before = snapshot.interventions.len();
        for (k, own) in changes.iter().enumerate() {
            if step_at(&task.scene, own.at()).map_err(|e| e.in_field(&format!("interventions[{k}]")))? < step
            {
                let allowed = format!("a time from the snapshot's on, {} s", snapshot.at);
                return Err(Error::input(format!("interventions[{k}].at"), own.at(), allowed));
            }
        }
        let all = [snapshot.interventions.clone(), changes].concat();
        let lists = std::slice::from_ref(&all);
        let numbered = |e| with_branch_index(e, before);
        self.check_interventions(&task.scene, lists, 1, snapshot.latents, true, budget).map_err(numbered)?;
        let actions = [action];
        let trial = AttemptSpec {
            task,
            actions: &actions,
            latents: snapshot.latents,
            stop: snapshot.stop,
            interventions: lists,
        };
        let (result, interactions) = self.attempt_one(&trial, budget).map_err(numbered)?;
        let engine = self.engine_for(task, &actions, lists);
        match result {
            Ok(trajectory) => Ok(BranchResult { engine, interactions, trajectory }),
            Err(reason) => Err(overlap_error(&reason)),
        }
    }

    /// Task, latents and action of the requested rollout.
    fn resolve_request(&self, asked: &SnapshotRequest) -> Result<(&Task, Latents, ValidAction)> {
        if let Some(action) = &asked.action {
            let (task, latents) = self.task_or_current(asked.task.as_deref())?;
            return Ok((task, latents, action.resolve(task.actions(), "action")?));
        }
        let none = "no step has been made; step the world first, or give the `action`";
        let made = lock(&self.state).last.clone().ok_or_else(|| conflict(none))?;
        let own = &self.tasks.tasks[made.task].id;
        if let Some(other) = asked.task.as_ref().filter(|task| *task != own) {
            let allowed = format!("{own:?}, the task of the last step; for another task give an `action`");
            return Err(Error::input("task", format!("{other:?}"), allowed));
        }
        Ok((&self.tasks.tasks[made.task], made.latents, made.action))
    }

    /// Simulates up to a snapshot.
    fn simulate_to(
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
            |own: &&Intervention| step_at(&task.scene, own.at()).is_ok_and(|step| step < snapshot.step);
        scene.interventions = snapshot.interventions.iter().filter(before).cloned().collect();
        scene.steps = snapshot.step.max(1);
        let (latents, stop) = (snapshot.latents, snapshot.stop);
        let rollout = Rollout { latents, effects: &self.effects, stop_at_goal: stop, ..Rollout::of(&scene) };
        let done = Simulator::new(self.engine).budget(budget).one(rollout)?;
        let mut done = reject_blocked(&scene, done).map_err(|reason| overlap_error(&reason))?;
        if snapshot.step == 0 {
            // Engines need one step to produce the initial states.
            done.times.truncate(1);
            done.bodies.iter_mut().for_each(|track| track.truncate(1));
            return Ok(done);
        }
        let ended = done.outcome.steps;
        if ended < scene.steps || done.outcome.end == Termination::Goal {
            let last = f64::from(ended) * scene.time_step;
            let allowed = format!("a time before {last} s, when this rollout ends");
            return Err(Error::input("at", snapshot.at, allowed));
        }
        Ok(done)
    }
}

fn overlap_error(reason: &str) -> Error {
    Error::input("interventions", reason, "interventions that leave no objects overlapping")
}

/// Renames an error's field `interventions[0][k]`: the first `before` belong to the snapshot, the rest to the branch.
fn with_branch_index(error: Error, before: usize) -> Error {
    with_field(error, |field| {
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
