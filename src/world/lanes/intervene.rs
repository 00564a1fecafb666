//! Interventions in a lane: only the changed data are written to it.
//!
//! An absent object stays in the batch with the radius [`ABSENT_RADIUS_M`], which nothing touches, at the
//! origin, where gravity and effects have no consequences.

use super::contact_pair::{ContactPair, NEVER_TOUCHED};
use super::goal::GoalLanes;
use super::load::outline::fill_body;
use super::load::{fill_static, slop_with};
use super::state::{ABSENT_RADIUS_M, BatchState};
use super::static_piece::pieces;
use crate::trajectory::Termination;
use crate::world::compile::RolloutModel;
use crate::world::compiled_intervention::{CompiledIntervention, InterventionOp};
use crate::world::goal::ObjectId;
use crate::world::intervene::apply;
use crate::world::record;

/// Applies a change to a lane; returns how its rollout ends, if it does.
pub fn intervene(
    state: &mut BatchState,
    goal: Option<&mut GoalLanes>,
    lane: usize,
    model: &mut RolloutModel,
    change: &CompiledIntervention,
) -> Option<Termination> {
    let before = state.bodies_in(lane);
    let mut after = before.clone();
    if let Err(by) = apply(model, &mut after, &change.op) {
        return Some(Termination::Blocked { intervention: change.number, by });
    }
    let count = model.bodies.len();
    match &change.op {
        InterventionOp::Impulse { body, .. } | InterventionOp::SetState { body, .. } => {
            if after[*body].pose_differs_from(&before[*body]) {
                state.set_body(lane, *body, &model.bodies[*body], &after[*body]);
                state.reset_pairs(lane, |contact| contact.is_of(*body));
                if let Some(goal) = goal {
                    goal.reset_limit(lane);
                }
            } else if !after[*body].has_velocity_of(&before[*body]) {
                state.set_speed(lane, *body, model, &after[*body]);
            }
        }
        InterventionOp::Add(ObjectId::Body(i)) => state.add_body(lane, *i, model),
        InterventionOp::Add(ObjectId::Static(s)) => state.add_static(lane, *s, model),
        InterventionOp::Remove(object) => {
            let unreachable = model.goal.as_ref().is_some_and(|own| !model.has_goal_objects(own));
            if let Some(goal) = goal.filter(|_| unreachable) {
                goal.clear(lane);
            }
            match object {
                ObjectId::Body(i) => state.remove(lane, *i),
                ObjectId::Static(s) => state.remove(lane, count + s),
            }
        }
        InterventionOp::SetMaterials { .. } => {
            for (i, own) in model.bodies.iter().enumerate() {
                state.load_mass(lane, i, own);
            }
            state.fill_pairs(lane, model);
        }
    }
    state.diverged(lane).then_some(Termination::Diverged)
}

impl BatchState {
    /// Removes an object (a body, or a static after all bodies) from a lane.
    pub fn remove(&mut self, lane: usize, object: usize) {
        if let Some(body) = self.bodies.get_mut(object) {
            body.radius[lane] = ABSENT_RADIUS_M;
        }
        self.reset_absent(lane);
        let statics = self.statics.iter_mut().filter(|s| self.bodies.len() + s.owner == object);
        statics.for_each(|s| s.radius[lane] = ABSENT_RADIUS_M);
        let outlines = self.outlines.iter_mut().filter(|o| o.owner == object);
        outlines.for_each(|o| o.radius[lane] = ABSENT_RADIUS_M);
        self.reset_pairs(lane, |contact| contact.is_of(object));
        self.reset_contact_times(lane, |contact| contact.is_of(object));
    }

    /// Resets the absent bodies of a lane to the origin, at rest.
    pub fn reset_absent(&mut self, lane: usize) {
        for body in self.bodies.iter_mut().filter(|b| b.radius[lane] == ABSENT_RADIUS_M) {
            let m = &mut body.moving;
            for v in [&mut m.x, &mut m.y, &mut m.vx, &mut m.vy, &mut m.omega] {
                v[lane] = 0.0;
            }
            for v in [&mut body.angle, &mut body.bias_x, &mut body.bias_y, &mut body.supported] {
                v[lane] = 0.0;
            }
        }
    }

    /// Sets the velocity of a body and keeps its pose.
    fn set_speed(&mut self, lane: usize, i: usize, model: &RolloutModel, to: &record::BodyState) {
        let (arm, moving) = (model.bodies[i].arm(to.angle), &mut self.bodies[i].moving);
        moving.vx[lane] = to.velocity[0] - to.omega * arm[1] + 0.0;
        moving.vy[lane] = to.velocity[1] + to.omega * arm[0] + 0.0;
        moving.omega[lane] = to.omega + 0.0;
    }

    /// Adds a body at its initial state.
    fn add_body(&mut self, lane: usize, i: usize, model: &RolloutModel) {
        let own = &model.bodies[i];
        self.fill_body(lane, i, own);
        if let Some(frame) = self.frames.get_mut(i) {
            fill_body(frame, &mut self.outlines, lane, own);
        }
        self.contact_margin[lane] = model.contact_margin;
        self.slop[lane] = self.slop[lane].min(slop_with(own));
        self.reset_pairs(lane, |contact| contact.is_of(i));
        self.reset_contact_times(lane, |contact| contact.is_of(i));
    }

    fn add_static(&mut self, lane: usize, s: usize, model: &RolloutModel) {
        for (fixed, (owner, piece)) in self.statics.iter_mut().zip(pieces(model)) {
            if owner == s {
                fill_static(fixed, lane, piece);
            }
        }
        let object = self.bodies.len() + s;
        let own = self.outlines.iter_mut().filter(|o| o.owner == object);
        let radii = pieces(model).filter(|(owner, _)| *owner == s).map(|(_, piece)| piece.radius());
        own.zip(radii).for_each(|(outline, radius)| outline.radius[lane] = radius);
        self.reset_pairs(lane, |contact| contact.is_of(object));
        self.reset_contact_times(lane, |contact| contact.is_of(object));
    }

    /// Resets the cached data of pairs, impulses included.
    pub fn reset_pairs(&mut self, lane: usize, which: impl Fn(&ContactPair) -> bool) {
        for pair in self.pairs.iter_mut().filter(|pair| which(&pair.contact)) {
            pair.limit[lane] = NEVER_TOUCHED;
            (pair.jn[lane], pair.jt[lane]) = (0.0, 0.0);
        }
        for near in self.near.iter_mut().filter(|near| which(&near.contact)) {
            near.limit[lane] = NEVER_TOUCHED;
            if let Some(slot) = near.slot {
                self.manifolds[slot].clear(lane);
            }
        }
    }

    /// Treats the next touch of pairs as a new contact.
    pub fn reset_contact_times(&mut self, lane: usize, which: impl Fn(&ContactPair) -> bool) {
        self.all_contacts_mut()
            .filter(|contact| which(contact))
            .for_each(|contact| contact.last_touch[lane] = NEVER_TOUCHED);
    }
}
