//! Interventions in the rollouts of a world: whether they can be carried out there, into which scenes they go, and what was in
//! their way.

use std::collections::HashSet;

use super::config::Kind;
use super::world::World;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::action::Quantity;
use crate::task::shape::Disc;
use crate::task::timeline::things;
use crate::task::{Intervention, Placement, Scene};
use crate::trajectory::{End, Trajectory};
use crate::world::{Latents, Rollout, chosen};

impl World {
    /// Errors unless rollouts of this world can be gone on from.
    pub(super) fn branches(&self) -> Result<()> {
        if self.kind == Kind::Real || self.sealed {
            return Err(Error::Sealed {
                reason: "a real or sealed world cannot be branched, nor changed in the middle of a rollout: reality \
                         happens once; branch a simulated world and compare"
                    .into(),
            });
        }
        Ok(())
    }

    /// Errors unless interventions can be carried out on a task's scene with so many actions, within what a request may cost,
    /// `samples_kept` or not.
    pub(super) fn intervened(
        &self,
        scene: &Scene,
        lists: &[Vec<Intervention>],
        actions: usize,
        latents: Latents,
        samples_kept: bool,
        budget: &dyn Budget,
    ) -> Result<()> {
        if lists.iter().all(Vec::is_empty) && lists.len() <= 1 {
            return self.limits.affordable(scene, actions as u64, samples_kept);
        }
        self.branches()?;
        if ![1, actions].contains(&lists.len()) {
            let allowed = format!("{actions} lists, one for each action, or one for all of them");
            return Err(Error::input("interventions", format!("{} lists", lists.len()), allowed));
        }
        self.limits.affordable(&with_all(scene, lists), actions as u64, samples_kept)?;
        let changes = lists.iter().map(Vec::len).sum::<usize>() * if lists.len() == 1 { actions } else { 1 };
        let things = scene.bodies.len() + scene.statics.len();
        self.limits.bearable((changes as u64).saturating_mul(things as u64).saturating_mul(CHANGE))?;
        let mut placed = scene.clone();
        for body in &mut placed.bodies {
            // An action decides; any place will do to ask, and the largest body bears most.
            body.position.get_or_insert([0.0, 0.0]);
            let mut sizes = scene.action.iter().flat_map(|a| &a.components);
            if let Some(size) = sizes.find(|c| c.target == body.name && c.set == Quantity::Radius) {
                body.shape = Disc { radius: size.low.max(size.high) }.into();
            }
        }
        for (i, list) in lists.iter().enumerate().filter(|(_, list)| !list.is_empty()) {
            budget.look()?;
            placed.interventions.clone_from(list);
            let rollout = Rollout { latents, effects: &self.effects, ..Rollout::of(&placed) };
            chosen(self.engine, &rollout).map_err(|e| of_list(e, i))?;
        }
        Ok(())
    }
}

/// Steps of a body that an intervention costs for each thing of its scene, more or less.
const CHANGE: u64 = 100;

/// The scene with a body for every name that is let in by any of the lists: answers have room for each in every rollout.
fn with_all(scene: &Scene, lists: &[Vec<Intervention>]) -> Scene {
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

/// What is done in the rollout of an action, by its place: there is a list for each, or one for all.
pub(super) fn of_action(lists: &[Vec<Intervention>], action: usize) -> &[Intervention] {
    let list = if lists.len() == 1 { lists.first() } else { lists.get(action) };
    list.map_or(&[], Vec::as_slice)
}

/// Puts interventions into the scenes of actions that can be placed.
pub(super) fn intervene(placements: &mut [Placement], lists: &[Vec<Intervention>]) {
    for (i, placement) in placements.iter_mut().enumerate() {
        if let Placement::Valid(scene) = placement {
            scene.interventions = of_action(lists, i).to_vec();
        }
    }
}

/// A rollout that came to its end; else what was in the way of an intervention.
pub(super) fn unblocked(scene: &Scene, trajectory: Trajectory) -> std::result::Result<Trajectory, String> {
    let End::Blocked { intervention, by } = trajectory.outcome.end else { return Ok(trajectory) };
    let names = things(scene).unwrap_or_default();
    let thing = scene.interventions.get(intervention).and_then(Intervention::thing).unwrap_or_default();
    let by = names.get(by).map_or("something", String::as_str);
    let at = f64::from(trajectory.outcome.steps) * scene.time_step;
    Err(format!("{thing} overlaps {by} at {at} s"))
}

/// The error about `interventions[k]` as one about `interventions[list][k]`.
pub(super) fn of_list(error: Error, list: usize) -> Error {
    renamed(error, |field| {
        field.strip_prefix("interventions").map(|rest| format!("interventions[{list}]{rest}"))
    })
}

/// The error with its field called otherwise, if it has another name.
pub(super) fn renamed(error: Error, name: impl Fn(&str) -> Option<String>) -> Error {
    let Error::Input(mut input) = error else { return error };
    if let Some(field) = name(&input.field) {
        input.field = field;
    }
    Error::Input(input)
}
