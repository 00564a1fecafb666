//! Warm start of contacts that exist before a rollout begins: the first step is repeated until their impulses
//! converge.
//!
//! Contact impulses are kept from step to step and are not part of an observed state. Without them, a stack
//! sways for many steps until the iterations have found the impulses: a pole with a ball on top by
//! millimetres.

use super::simd::V;
use super::state::BatchState;
use crate::world::compile::RolloutModel;

/// Maximum number of repetitions of the first step.
const MAX_REPETITIONS: u32 = 12;
/// Convergence tolerance of the impulses, relative to the largest one.
const IMPULSE_CONVERGENCE_TOLERANCE: f64 = 1e-6;
/// Largest contraction factor per repetition at which changes are extrapolated: there, a change is a
/// thousandth of the remaining error.
const MAX_CONVERGENCE_RATE: f64 = 0.999;

/// The warm start of a rollout whose first step is not final.
pub struct ContactWarmStart {
    model: Box<RolloutModel>,
    /// Impulses of the lane's contacts after the last repetition, N s, and their change since the
    /// previous one, if it was not extrapolated.
    before: Vec<f64>,
    changes: Option<Vec<f64>>,
    repetitions: u32,
}

impl ContactWarmStart {
    pub fn new(model: RolloutModel) -> ContactWarmStart {
        ContactWarmStart { model: Box::new(model), before: Vec::new(), changes: None, repetitions: 0 }
    }

    /// After the first step: resets the lane to its initial state, with the current impulses, unless they
    /// have converged. Returns whether it did.
    ///
    /// The impulses converge linearly, and slowly under a heavy body: the limit is extrapolated from two
    /// changes (Aitken's method).
    pub fn restart(&mut self, state: &mut BatchState, lane: usize) -> bool {
        let mut now = impulses(state, lane);
        let largest = now.iter().fold(0.0_f64, |most, j| most.max(j.abs()));
        let changed: Vec<f64> = now.iter().zip(&self.before).map(|(a, b)| a - b).collect();
        let found =
            !changed.is_empty() && changed.iter().all(|c| c.abs() <= IMPULSE_CONVERGENCE_TOLERANCE * largest);
        if found || largest == 0.0 || self.repetitions == MAX_REPETITIONS {
            return false;
        }
        let contraction = self.changes.take().map_or(0.0, |last| dot(&changed, &last) / dot(&last, &last));
        if contraction > 0.0 && contraction < MAX_CONVERGENCE_RATE {
            let rest = contraction / (1.0 - contraction);
            now.iter_mut().zip(&changed).for_each(|(j, c)| *j += rest * c);
            set_impulses(state, lane, &now);
        } else if !changed.is_empty() {
            self.changes = Some(changed);
        }
        (self.before, self.repetitions) = (now, self.repetitions + 1);
        reset_bodies(state, lane, &self.model);
        true
    }
}

/// Impulses of the lane's contacts, N s: the normal and the tangential impulse of each point.
fn impulses(state: &mut BatchState, lane: usize) -> Vec<f64> {
    let mut all = Vec::new();
    for_each_impulse(state, |jn, jt| all.extend([jn[lane], jt[lane]]));
    all
}

/// Sets the impulses of the contacts; normal impulses are not negative.
fn set_impulses(state: &mut BatchState, lane: usize, all: &[f64]) {
    let mut pairs = all.chunks_exact(2);
    for_each_impulse(state, |jn, jt| {
        if let Some([normal, across]) = pairs.next() {
            (jn[lane], jt[lane]) = (normal.max(0.0), *across);
        }
    });
}

/// Visits the impulses of all points of all contacts, in a fixed order.
fn for_each_impulse(state: &mut BatchState, mut of: impl FnMut(&mut V, &mut V)) {
    let BatchState { pairs, near, manifolds, .. } = state;
    pairs.iter_mut().for_each(|p| of(&mut p.jn, &mut p.jt));
    for near in near {
        // Whether a manifold exists depends on all lanes; its impulses in this lane do not.
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

/// Resets a lane's bodies to their initial state at this tick and keeps the impulses.
fn reset_bodies(state: &mut BatchState, lane: usize, model: &RolloutModel) {
    for (i, own) in model.bodies.iter().enumerate() {
        state.set_body(lane, i, own, &own.initial_state());
        state.bodies[i].rolling[lane] = 0.0;
    }
    state.reset_contact_times(lane, |_| true);
    state.all_contacts_mut().for_each(|contact| contact.begins[lane] = 0.0);
    state.start_tick[lane] = state.tick;
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
