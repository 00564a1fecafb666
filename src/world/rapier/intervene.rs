//! Interventions in a rollout of the general engine: what is different afterwards is told to rapier, and nothing else.

use std::borrow::Cow;

use rapier2d::prelude::*;

use super::{World, mass_properties, vector};
use crate::error::Result;
use crate::trajectory::End;
use crate::world::change::Act;
use crate::world::goal::Party;
use crate::world::intervene::carry_out;
use crate::world::prepare::Prepared;
use crate::world::record::State;

impl World {
    /// Does what is to be done after `step` steps, with the bodies at `states`; how the rollout ends, if it does.
    pub(super) fn intervene(
        &mut self,
        prepared: &mut Cow<Prepared>,
        step: u32,
        states: &[State],
    ) -> Result<Option<End>> {
        let from = prepared.changes.partition_point(|c| c.step < step);
        if prepared.changes.get(from).is_none_or(|c| c.step > step) {
            return Ok(None);
        }
        let prepared = prepared.to_mut();
        let mut states = states.to_vec();
        for k in from..prepared.changes.len() {
            let change = prepared.changes[k].clone();
            if change.step > step {
                break;
            }
            let before = states.clone();
            if let Err(by) = carry_out(prepared, &mut states, &change.act) {
                return Ok(Some(End::Blocked { intervention: change.number, by }));
            }
            self.take_over(prepared, &change.act, &before, &states)?;
            if states.iter().zip(&prepared.bodies).any(|(s, own)| own.there && !s.is_finite()) {
                return Ok(Some(End::Diverged));
            }
        }
        Ok(None)
    }

    fn take_over(&mut self, prepared: &Prepared, act: &Act, before: &[State], after: &[State]) -> Result<()> {
        match act {
            Act::Push { body, .. } | Act::Put { body, .. } => {
                self.move_body(prepared, *body, &before[*body], &after[*body]);
            }
            Act::Add(Party::Body(i)) => {
                let unit = (prepared.touch / 0.005) as f32;
                let parameters = &mut self.physics.integration_parameters;
                parameters.length_unit = unit;
                parameters.normalized_max_linear_velocity = 400.0 / unit;
                self.insert_body(prepared, *i, &prepared.path_of(Party::Body(*i)))?;
            }
            Act::Add(Party::Static(s)) => {
                self.insert_static(prepared, *s, &prepared.path_of(Party::Static(*s)))?;
            }
            Act::Remove(Party::Body(i)) => {
                self.bodies[*i].take().map(|handle| self.physics.remove_body(handle));
            }
            Act::Remove(Party::Static(s)) => {
                for handle in std::mem::take(&mut self.statics[*s]) {
                    self.physics.remove_collider(handle);
                }
            }
            Act::Matter { .. } => self.renew_matter(prepared),
        }
        Ok(())
    }

    /// Tells rapier of a body's state after `before`.
    pub(super) fn move_body(&mut self, prepared: &Prepared, i: usize, before: &State, after: &State) {
        let Some(body) = self.bodies[i].and_then(|handle| self.physics.bodies.get_mut(handle)) else {
            return;
        };
        if after.moved_from(before) {
            body.set_position(Pose::new(vector(after.position), after.angle as f32), false);
            self.angles[i] = after.angle;
        }
        if after.moved_from(before) || !after.goes_as(before) {
            let [ax, ay] = prepared.bodies[i].arm(after.angle);
            let of_centre = [after.velocity[0] - after.omega * ay, after.velocity[1] + after.omega * ax];
            body.set_linvel(vector(of_centre), false);
            body.set_angvel(after.omega as f32, false);
        }
    }

    /// Tells rapier of masses and surfaces that have become others.
    fn renew_matter(&mut self, prepared: &Prepared) {
        for (handle, own) in self.bodies.iter().zip(&prepared.bodies) {
            let Some(body) = handle.and_then(|handle| self.physics.bodies.get(handle)) else { continue };
            for (n, handle) in body.colliders().iter().enumerate() {
                let Some(collider) = self.physics.colliders.get_mut(*handle) else { continue };
                renew_surface(collider, [own.friction, own.restitution]);
                let mass = mass_properties(own);
                if n == 0 && collider.mass_properties().inv_mass != mass.inv_mass {
                    collider.set_mass_properties(mass);
                }
            }
        }
        for (handles, own) in self.statics.iter().zip(&prepared.statics) {
            for handle in handles {
                let Some(collider) = self.physics.colliders.get_mut(*handle) else { continue };
                renew_surface(collider, [own.friction, own.restitution]);
            }
        }
    }
}

fn renew_surface(collider: &mut Collider, [friction, restitution]: [f64; 2]) {
    collider.set_friction(friction as f32);
    collider.set_restitution(restitution as f32);
}
