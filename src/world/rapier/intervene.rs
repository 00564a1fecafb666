//! Interventions in the general engine: only the changed data are copied to rapier.

use std::borrow::Cow;

use rapier2d::prelude::*;

use super::{RapierWorld, mass_properties, vector};
use crate::error::Result;
use crate::trajectory::Termination;
use crate::world::compile::RolloutModel;
use crate::world::compiled_intervention::InterventionOp;
use crate::world::goal::ObjectId;
use crate::world::intervene::apply;
use crate::world::record::BodyState;

impl RapierWorld {
    /// Applies the interventions after `step` steps, with the bodies at `states`; returns how the rollout
    /// ends, if it does.
    pub(super) fn intervene(
        &mut self,
        model: &mut Cow<RolloutModel>,
        step: u32,
        states: &[BodyState],
    ) -> Result<Option<Termination>> {
        let from = model.interventions.partition_point(|c| c.step < step);
        if model.interventions.get(from).is_none_or(|c| c.step > step) {
            return Ok(None);
        }
        let model = model.to_mut();
        let mut states = states.to_vec();
        for k in from..model.interventions.len() {
            let change = model.interventions[k].clone();
            if change.step > step {
                break;
            }
            let before = states.clone();
            if let Err(by) = apply(model, &mut states, &change.op) {
                return Ok(Some(Termination::Blocked { intervention: change.number, by }));
            }
            self.copy_changes(model, &change.op, &before, &states)?;
            if states.iter().zip(&model.bodies).any(|(s, own)| own.present && !s.is_finite()) {
                return Ok(Some(Termination::Diverged));
            }
        }
        Ok(None)
    }

    fn copy_changes(
        &mut self,
        model: &RolloutModel,
        op: &InterventionOp,
        before: &[BodyState],
        after: &[BodyState],
    ) -> Result<()> {
        match op {
            InterventionOp::Impulse { body, .. } | InterventionOp::SetState { body, .. } => {
                self.move_body(model, *body, &before[*body], &after[*body]);
            }
            InterventionOp::Add(ObjectId::Body(i)) => {
                let unit = (model.contact_margin / 0.005) as f32;
                let parameters = &mut self.physics.integration_parameters;
                parameters.length_unit = unit;
                parameters.normalized_max_linear_velocity = 400.0 / unit;
                self.insert_body(model, *i, &model.input_path(ObjectId::Body(*i)))?;
            }
            InterventionOp::Add(ObjectId::Static(s)) => {
                self.insert_static(model, *s, &model.input_path(ObjectId::Static(*s)))?;
            }
            InterventionOp::Remove(ObjectId::Body(i)) => {
                self.bodies[*i].take().map(|handle| self.physics.remove_body(handle));
            }
            InterventionOp::Remove(ObjectId::Static(s)) => {
                for handle in std::mem::take(&mut self.statics[*s]) {
                    self.physics.remove_collider(handle);
                }
            }
            InterventionOp::SetMaterials { .. } => self.copy_materials(model),
        }
        Ok(())
    }

    /// Copies a body's state to rapier if it differs from `before`.
    pub(super) fn move_body(
        &mut self,
        model: &RolloutModel,
        i: usize,
        before: &BodyState,
        after: &BodyState,
    ) {
        let Some(body) = self.bodies[i].and_then(|handle| self.physics.bodies.get_mut(handle)) else {
            return;
        };
        if after.pose_differs_from(before) {
            body.set_position(Pose::new(vector(after.position), after.angle as f32), false);
            self.angles[i] = after.angle;
        }
        if after.pose_differs_from(before) || !after.has_velocity_of(before) {
            let [ax, ay] = model.bodies[i].arm(after.angle);
            let of_centre = [after.velocity[0] - after.omega * ay, after.velocity[1] + after.omega * ax];
            body.set_linvel(vector(of_centre), false);
            body.set_angvel(after.omega as f32, false);
        }
    }

    /// Copies changed masses and surfaces to rapier.
    fn copy_materials(&mut self, model: &RolloutModel) {
        for (handle, own) in self.bodies.iter().zip(&model.bodies) {
            let Some(body) = handle.and_then(|handle| self.physics.bodies.get(handle)) else { continue };
            for (n, handle) in body.colliders().iter().enumerate() {
                let Some(collider) = self.physics.colliders.get_mut(*handle) else { continue };
                copy_surface(collider, [own.friction, own.restitution]);
                let mass = mass_properties(own);
                if n == 0 && collider.mass_properties().inv_mass != mass.inv_mass {
                    collider.set_mass_properties(mass);
                }
            }
        }
        for (handles, own) in self.statics.iter().zip(&model.statics) {
            for handle in handles {
                let Some(collider) = self.physics.colliders.get_mut(*handle) else { continue };
                copy_surface(collider, [own.friction, own.restitution]);
            }
        }
    }
}

fn copy_surface(collider: &mut Collider, [friction, restitution]: [f64; 2]) {
    collider.set_friction(friction as f32);
    collider.set_restitution(restitution as f32);
}
