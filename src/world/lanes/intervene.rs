//! Interventions in a lane: what is different afterwards is written into it, and nothing else.
//!
//! What is not in the scene stays in the batch as something of radius [`NOTHING`] that nothing touches: at the origin, where gravity
//! and effects are its own affair.

use super::fill::{fill_static, slop_with};
use super::goal::GoalLanes;
use super::outline::fill_body;
use super::piece::pieces;
use super::state::{NOTHING, State};
use super::touching::{Met, NEVER_TOUCHED};
use crate::trajectory::End;
use crate::world::change::{Act, Change};
use crate::world::goal::Party;
use crate::world::intervene::carry_out;
use crate::world::prepare::Prepared;
use crate::world::record;

/// Does a change to a lane; how its rollout ends, if it does.
pub fn intervene(
    state: &mut State,
    goal: Option<&mut GoalLanes>,
    lane: usize,
    prepared: &mut Prepared,
    change: &Change,
) -> Option<End> {
    let before = state.bodies_in(lane);
    let mut after = before.clone();
    if let Err(by) = carry_out(prepared, &mut after, &change.act) {
        return Some(End::Blocked { intervention: change.number, by });
    }
    let count = prepared.bodies.len();
    match &change.act {
        Act::Push { body, .. } | Act::Put { body, .. } => {
            if after[*body].moved_from(&before[*body]) {
                state.set_body(lane, *body, &prepared.bodies[*body], &after[*body]);
                state.begin_pairs(lane, |met| met.is_of(*body));
                if let Some(goal) = goal {
                    goal.look_again(lane);
                }
            } else if !after[*body].goes_as(&before[*body]) {
                state.set_speed(lane, *body, prepared, &after[*body]);
            }
        }
        Act::Add(Party::Body(i)) => state.let_in(lane, *i, prepared),
        Act::Add(Party::Static(s)) => state.let_static_in(lane, *s, prepared),
        Act::Remove(thing) => {
            let unreachable = prepared.goal.as_ref().is_some_and(|own| !prepared.has(own));
            if let Some(goal) = goal.filter(|_| unreachable) {
                goal.clear(lane);
            }
            match thing {
                Party::Body(i) => state.hide(lane, *i),
                Party::Static(s) => state.hide(lane, count + s),
            }
        }
        Act::Matter { .. } => {
            for (i, own) in prepared.bodies.iter().enumerate() {
                state.fill_matter(lane, i, own);
            }
            state.fill_pairs(lane, prepared);
        }
    }
    state.diverged(lane).then_some(End::Diverged)
}

impl State {
    /// Takes a thing (a body, or a static after all bodies) out of a lane.
    pub fn hide(&mut self, lane: usize, thing: usize) {
        if let Some(body) = self.bodies.get_mut(thing) {
            body.radius[lane] = NOTHING;
        }
        self.park(lane);
        let statics = self.statics.iter_mut().filter(|s| self.bodies.len() + s.owner == thing);
        statics.for_each(|s| s.radius[lane] = NOTHING);
        let outlines = self.outlines.iter_mut().filter(|o| o.owner == thing);
        outlines.for_each(|o| o.radius[lane] = NOTHING);
        self.begin_pairs(lane, |met| met.is_of(thing));
        self.forget_touches(lane, |met| met.is_of(thing));
    }

    /// Puts what is not in the lane's scene back to the origin, at rest.
    pub fn park(&mut self, lane: usize) {
        for body in self.bodies.iter_mut().filter(|b| b.radius[lane] == NOTHING) {
            let m = &mut body.moving;
            for v in [&mut m.x, &mut m.y, &mut m.vx, &mut m.vy, &mut m.omega] {
                v[lane] = 0.0;
            }
            for v in [&mut body.angle, &mut body.bias_x, &mut body.bias_y, &mut body.carried] {
                v[lane] = 0.0;
            }
        }
    }

    /// Sets how a body moves, and not where it is.
    fn set_speed(&mut self, lane: usize, i: usize, prepared: &Prepared, to: &record::State) {
        let (arm, moving) = (prepared.bodies[i].arm(to.angle), &mut self.bodies[i].moving);
        moving.vx[lane] = to.velocity[0] - to.omega * arm[1] + 0.0;
        moving.vy[lane] = to.velocity[1] + to.omega * arm[0] + 0.0;
        moving.omega[lane] = to.omega + 0.0;
    }

    /// Lets a body in where it starts.
    fn let_in(&mut self, lane: usize, i: usize, prepared: &Prepared) {
        let own = &prepared.bodies[i];
        self.fill_body(lane, i, own);
        if let Some(frame) = self.frames.get_mut(i) {
            fill_body(frame, &mut self.outlines, lane, own);
        }
        self.touch[lane] = prepared.touch;
        self.slop[lane] = self.slop[lane].min(slop_with(own));
        self.begin_pairs(lane, |met| met.is_of(i));
        self.forget_touches(lane, |met| met.is_of(i));
    }

    fn let_static_in(&mut self, lane: usize, s: usize, prepared: &Prepared) {
        for (fixed, (owner, piece)) in self.statics.iter_mut().zip(pieces(prepared)) {
            if owner == s {
                fill_static(fixed, lane, piece);
            }
        }
        let thing = self.bodies.len() + s;
        let own = self.outlines.iter_mut().filter(|o| o.owner == thing);
        let radii = pieces(prepared).filter(|(owner, _)| *owner == s).map(|(_, piece)| piece.radius());
        own.zip(radii).for_each(|(outline, radius)| outline.radius[lane] = radius);
        self.begin_pairs(lane, |met| met.is_of(thing));
        self.forget_touches(lane, |met| met.is_of(thing));
    }

    /// What is kept of pairs begins anew, without impulses.
    pub fn begin_pairs(&mut self, lane: usize, which: impl Fn(&Met) -> bool) {
        for pair in self.pairs.iter_mut().filter(|pair| which(&pair.met)) {
            pair.limit[lane] = NEVER_TOUCHED;
            (pair.jn[lane], pair.jt[lane]) = (0.0, 0.0);
        }
        for near in self.near.iter_mut().filter(|near| which(&near.met)) {
            near.limit[lane] = NEVER_TOUCHED;
            if let Some(slot) = near.slot {
                self.manifolds[slot].clear(lane);
            }
        }
    }

    /// Pairs that touch from here on begin to.
    pub fn forget_touches(&mut self, lane: usize, which: impl Fn(&Met) -> bool) {
        self.all_met_mut().filter(|met| which(met)).for_each(|met| met.last_touch[lane] = NEVER_TOUCHED);
    }
}
