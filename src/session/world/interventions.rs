//! Interventions in the rollouts of a world: validation, application to placed scenes, and overlap errors.

use std::collections::HashSet;

use super::World;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::session::config::WorldKind;
use crate::task::action::ActionQuantity;
use crate::task::shape::Disc;
use crate::task::timeline::object_names;
use crate::task::{Intervention, Placement, Scene};
use crate::trajectory::{Termination, Trajectory};
use crate::world::{Latents, Rollout, select_engine};

impl World {
    /// Fails for real and sealed worlds, whose rollouts cannot be branched.
    pub(super) fn check_branchable(&self) -> Result<()> {
        if self.kind == WorldKind::Real || self.sealed {
            return Err(Error::Sealed {
                reason: "a real or sealed world cannot be branched or changed during a rollout; \
                         branch a simulated world and compare"
                    .into(),
            });
        }
        Ok(())
    }

    /// Checks that the interventions are valid for a task's scene and `actions` rollouts, and that the request stays within
    /// its limits.
    pub(super) fn check_interventions(
        &self,
        scene: &Scene,
        lists: &[Vec<Intervention>],
        actions: usize,
        latents: Latents,
        samples_kept: bool,
        budget: &dyn Budget,
    ) -> Result<()> {
        if lists.iter().all(Vec::is_empty) && lists.len() <= 1 {
            return self.limits.check_cost(scene, actions as u64, samples_kept);
        }
        self.check_branchable()?;
        if ![1, actions].contains(&lists.len()) {
            let allowed = format!("{actions} lists, one for each action, or one for all of them");
            return Err(Error::input("interventions", format!("{} lists", lists.len()), allowed));
        }
        self.limits.check_cost(&with_added_bodies(scene, lists), actions as u64, samples_kept)?;
        let changes = lists.iter().map(Vec::len).sum::<usize>() * if lists.len() == 1 { actions } else { 1 };
        let things = scene.bodies.len() + scene.statics.len();
        self.limits.check_work(
            (changes as u64).saturating_mul(things as u64).saturating_mul(BODY_STEPS_PER_CHANGE),
        )?;
        let mut placed = scene.clone();
        for body in &mut placed.bodies {
            // The action sets it; any position will do for the check, and the largest radius is the worst case.
            body.position.get_or_insert([0.0, 0.0]);
            let mut sizes = scene.action.iter().flat_map(|a| &a.components);
            if let Some(size) = sizes.find(|c| c.target == body.name && c.set == ActionQuantity::Radius) {
                body.shape = Disc { radius: size.low.max(size.high) }.into();
            }
        }
        for (i, list) in lists.iter().enumerate().filter(|(_, list)| !list.is_empty()) {
            budget.check()?;
            placed.interventions.clone_from(list);
            let rollout = Rollout { latents, effects: &self.effects, ..Rollout::of(&placed) };
            select_engine(self.engine, &rollout).map_err(|e| with_list_index(e, i))?;
        }
        Ok(())
    }
}

/// Approximate cost of one intervention per object of the scene, in body-time-steps.
const BODY_STEPS_PER_CHANGE: u64 = 100;

/// The scene with every body that any intervention adds; results reserve space for each of them in every rollout.
fn with_added_bodies(scene: &Scene, lists: &[Vec<Intervention>]) -> Scene {
    let mut all = scene.clone();
    let mut names: HashSet<&str> = HashSet::new();
    for own in lists.iter().flatten() {
        if let Intervention::Add { body, .. } = own
            && names.insert(&body.name)
        {
            all.bodies.push(body.clone());
        }
    }
    all
}

/// The interventions for the action at this index: its own list, or the one shared by all.
pub(super) fn interventions_of(lists: &[Vec<Intervention>], action: usize) -> &[Intervention] {
    let list = if lists.len() == 1 { lists.first() } else { lists.get(action) };
    list.map_or(&[], Vec::as_slice)
}

/// Adds the interventions to the scenes of valid placements.
pub(super) fn apply_interventions(placements: &mut [Placement], lists: &[Vec<Intervention>]) {
    for (i, placement) in placements.iter_mut().enumerate() {
        if let Placement::Valid(scene) = placement {
            scene.interventions = interventions_of(lists, i).to_vec();
        }
    }
}

/// The trajectory, or an error naming the object that blocked an intervention.
pub(super) fn reject_blocked(
    scene: &Scene,
    trajectory: Trajectory,
) -> std::result::Result<Trajectory, String> {
    let Termination::Blocked { intervention, by } = trajectory.outcome.end else { return Ok(trajectory) };
    let names = object_names(scene).unwrap_or_default();
    let thing = scene.interventions.get(intervention).and_then(Intervention::object).unwrap_or_default();
    let by = names.get(by).map_or("something", String::as_str);
    let at = f64::from(trajectory.outcome.steps) * scene.time_step;
    Err(format!("{thing} overlaps {by} at {at} s"))
}

/// Renames an error's field `interventions[k]` to `interventions[list][k]`.
pub(super) fn with_list_index(error: Error, list: usize) -> Error {
    with_field(error, |field| {
        field.strip_prefix("interventions").map(|rest| format!("interventions[{list}]{rest}"))
    })
}

/// Renames an error's field by `name`, if that returns a new name.
pub(super) fn with_field(error: Error, name: impl Fn(&str) -> Option<String>) -> Error {
    error.map_input(|input| {
        if let Some(field) = name(&input.field) {
            input.field = field;
        }
    })
}
