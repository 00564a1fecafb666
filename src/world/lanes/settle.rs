//! Contacts that have lasted before a rollout begins: their impulses are found by making its first step again and again.
//!
//! What a contact bears is kept from step to step and is no part of what is seen of a state. Begun anew, a body that rests on others
//! sways until the sweeps of many steps have found how it is borne: a pole with a ball on top by millimetres.

use super::simd::V;
use super::state::State;
use crate::world::prepare::Prepared;

/// Most times that the first step is made again.
const MOST: u32 = 12;
/// Share of the largest impulse by which none changes any more when all are found.
const FOUND: f64 = 1e-6;
/// Largest factor by which changes may shrink from one time to the next and still be followed to their end: there, changes
/// are a thousandth of what is left.
const SLOWEST: f64 = 0.999;

/// A rollout whose first step is not yet final.
pub struct Settling {
    prepared: Box<Prepared>,
    /// Impulses of the lane's contacts after the last time, N s, and what they had changed by since the time before that, if it was
    /// by sweeps alone.
    before: Vec<f64>,
    changes: Option<Vec<f64>>,
    again: u32,
}

impl Settling {
    pub fn new(prepared: Prepared) -> Settling {
        Settling { prepared: Box::new(prepared), before: Vec::new(), changes: None, again: 0 }
    }

    /// After the first step: puts the lane back to where it starts, impulses kept, unless these are found already. Whether it did.
    ///
    /// Sweeps come near what they go to by the same share every time, and slowly under a heavy body: what is still to come is
    /// taken from two changes (Aitken's extrapolation).
    pub fn back(&mut self, state: &mut State, lane: usize) -> bool {
        let mut now = impulses(state, lane);
        let largest = now.iter().fold(0.0_f64, |most, j| most.max(j.abs()));
        let changed: Vec<f64> = now.iter().zip(&self.before).map(|(a, b)| a - b).collect();
        let found = !changed.is_empty() && changed.iter().all(|c| c.abs() <= FOUND * largest);
        if found || largest == 0.0 || self.again == MOST {
            return false;
        }
        let shrinks = self.changes.take().map_or(0.0, |last| dot(&changed, &last) / dot(&last, &last));
        if shrinks > 0.0 && shrinks < SLOWEST {
            let rest = shrinks / (1.0 - shrinks);
            now.iter_mut().zip(&changed).for_each(|(j, c)| *j += rest * c);
            set_impulses(state, lane, &now);
        } else if !changed.is_empty() {
            self.changes = Some(changed);
        }
        (self.before, self.again) = (now, self.again + 1);
        begin_again(state, lane, &self.prepared);
        true
    }
}

/// What the lane's contacts bear, N s: of each point the normal and the tangential impulse.
fn impulses(state: &mut State, lane: usize) -> Vec<f64> {
    let mut all = Vec::new();
    each(state, |jn, jt| all.extend([jn[lane], jt[lane]]));
    all
}

/// Lets contacts bear other impulses; none pulls.
fn set_impulses(state: &mut State, lane: usize, all: &[f64]) {
    let mut pairs = all.chunks_exact(2);
    each(state, |jn, jt| {
        if let Some([normal, across]) = pairs.next() {
            (jn[lane], jt[lane]) = (normal.max(0.0), *across);
        }
    });
}

/// Impulses of all points of all contacts, in an order that stays.
fn each(state: &mut State, mut of: impl FnMut(&mut V, &mut V)) {
    let State { pairs, near, manifolds, .. } = state;
    pairs.iter_mut().for_each(|p| of(&mut p.jn, &mut p.jt));
    for near in near {
        // Whether there is a contact depends on all lanes; what it bears in this one does not.
        let mut none = [V::all(0.0); 4];
        match near.slot {
            Some(slot) => manifolds[slot].points.iter_mut().for_each(|p| of(&mut p.jn, &mut p.jt)),
            None => none.chunks_exact_mut(2).for_each(|p| {
                let [jn, jt] = p else { return };
                of(jn, jt);
            }),
        }
    }
}

/// Puts a lane's bodies back to where they start, at this tick; what their contacts bear is kept.
fn begin_again(state: &mut State, lane: usize, prepared: &Prepared) {
    for (i, own) in prepared.bodies.iter().enumerate() {
        state.set_body(lane, i, own, &own.start());
        state.bodies[i].rolling[lane] = 0.0;
    }
    state.forget_touches(lane, |_| true);
    state.all_met_mut().for_each(|met| met.begins[lane] = 0.0);
    state.born[lane] = state.tick;
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
