//! Interventions in the rollouts of a world: whether they can be carried out there, into which scenes they go, and what was in
//! their way.

use super::config::Kind;
use super::world::World;
use crate::error::{Error, Result};
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

    /// Errors unless interventions can be carried out on a task's scene with so many actions: then the scene with the most
    /// bodies that any of them makes.
    pub(super) fn intervened(
        &self,
        scene: &Scene,
        lists: &[Vec<Intervention>],
        actions: usize,
        latents: Latents,
    ) -> Result<Scene> {
        let mut largest = scene.clone();
        if lists.iter().all(Vec::is_empty) && lists.len() <= 1 {
            return Ok(largest);
        }
        self.branches()?;
        if ![1, actions].contains(&lists.len()) {
            let allowed = format!("{actions} lists, one for each action, or one for all of them");
            return Err(Error::input("interventions", format!("{} lists", lists.len()), allowed));
        }
        let mut placed = scene.clone();
        for body in &mut placed.bodies {
            // An action decides; any place will do to ask.
            body.position.get_or_insert([0.0, 0.0]);
        }
        for (i, list) in lists.iter().enumerate() {
            placed.interventions.clone_from(list);
            let rollout = Rollout { scene: &placed, latents, effects: &self.effects, stop: true };
            chosen(self.engine, &rollout).map_err(|e| of_list(e, i))?;
            let added = list.iter().filter_map(|own| match own {
                Intervention::Add { body, .. } => Some(body.clone()),
                _ => None,
            });
            let bodies: Vec<_> = scene.bodies.iter().cloned().chain(added).collect();
            if bodies.len() > largest.bodies.len() {
                largest.bodies = bodies;
            }
        }
        Ok(largest)
    }
}

/// Puts interventions into the scenes of actions that can be placed: a list for each, or one for all.
pub(super) fn intervene(placements: &mut [Placement], lists: &[Vec<Intervention>]) {
    for (i, placement) in placements.iter_mut().enumerate() {
        let list = if lists.len() == 1 { lists.first() } else { lists.get(i) };
        if let (Placement::Valid(scene), Some(list)) = (placement, list) {
            scene.interventions.clone_from(list);
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
fn of_list(error: Error, list: usize) -> Error {
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
