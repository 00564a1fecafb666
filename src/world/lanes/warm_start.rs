//! Warm start of contacts that exist before a rollout begins: the first step is repeated until their impulses
//! converge.
//!
//! Contact impulses are kept from step to step and are not part of an observed state. Without them, a stack
//! sways for many steps until the iterations have found the impulses: a pole with a ball on top by
//! millimetres.

use super::contact_pair::NEVER_TOUCHED;
use super::simd::V;
use super::state::BatchState;
use super::topology::Topology;

/// Maximum number of repetitions of the first step.
const MAX_REPETITIONS: u32 = 12;
/// Convergence tolerance of the impulses, relative to the largest one.
const IMPULSE_CONVERGENCE_TOLERANCE: f64 = 1e-6;
/// Largest contraction factor per repetition at which changes are extrapolated: there, a change is a
/// thousandth of the remaining error.
const MAX_CONVERGENCE_RATE: f64 = 0.999;

/// The warm start of a rollout whose first step is not final. Its memory is reused.
#[derive(Default)]
pub struct ContactWarmStart {
    /// Pose and velocity of each body at the start: x, y, angle, vx, vy, omega of its centre of mass.
    start: Vec<[f64; 6]>,
    /// Impulses of the lane's contacts, N s: now, after the last repetition, and their change in it.
    now: Vec<f64>,
    before: Vec<f64>,
    changes: Vec<f64>,
    /// Whether the changes belong to two repetitions in sequence, without an extrapolation between them.
    has_changes: bool,
    repetitions: u32,
    pending: bool,
}

impl ContactWarmStart {
    /// One with memory for these bodies and contacts, if rollouts begin with established contacts.
    pub fn new(topology: &Topology, state: &BatchState) -> ContactWarmStart {
        if !topology.contacts_established {
            return ContactWarmStart::default();
        }
        let impulses = || Vec::with_capacity(2 * state.pairs.len() + 4 * state.near.len());
        ContactWarmStart {
            start: Vec::with_capacity(state.bodies.len()),
            now: impulses(),
            before: impulses(),
            changes: impulses(),
            ..ContactWarmStart::default()
        }
    }

    /// Begins with the initial state in the lane.
    pub fn begin(&mut self, state: &BatchState, lane: usize) {
        self.start.clear();
        self.start.extend(state.bodies.iter().map(|body| {
            let m = &body.moving;
            [m.x[lane], m.y[lane], body.angle[lane], m.vx[lane], m.vy[lane], m.omega[lane]]
        }));
        self.before.clear();
        (self.has_changes, self.repetitions, self.pending) = (false, 0, true);
    }

    /// Whether the first step is still being repeated.
    pub fn is_pending(&self) -> bool {
        self.pending
    }

    /// Ends it with its rollout.
    pub fn end(&mut self) {
        self.pending = false;
    }

    /// After the first step: resets the lane to its initial state, with the current impulses, unless they
    /// have converged. Returns whether it did.
    ///
    /// The impulses converge linearly, and slowly under a heavy body: the limit is extrapolated from two
    /// changes (Aitken's method).
    pub fn restart(&mut self, state: &mut BatchState, lane: usize) -> bool {
        let ContactWarmStart { now, before, changes, .. } = self;
        now.clear();
        for_each_impulse(state, |jn, jt| now.extend([jn[lane], jt[lane]]));
        let largest = now.iter().fold(0.0_f64, |most, j| most.max(j.abs()));
        let changed = || now.iter().zip(before.iter()).map(|(a, b)| a - b);
        let repeated = !before.is_empty();
        let found = repeated && changed().all(|c| c.abs() <= IMPULSE_CONVERGENCE_TOLERANCE * largest);
        if found || largest == 0.0 || self.repetitions == MAX_REPETITIONS {
            self.pending = false;
            return false;
        }
        let contraction = if self.has_changes {
            dot(changed(), changes) / dot(changes.iter().copied(), changes)
        } else {
            0.0
        };
        let extrapolates = contraction > 0.0 && contraction < MAX_CONVERGENCE_RATE;
        self.has_changes = repeated && !extrapolates;
        changes.clear();
        changes.extend(changed());
        if extrapolates {
            let rest = contraction / (1.0 - contraction);
            now.iter_mut().zip(changes.iter()).for_each(|(j, c)| *j += rest * c);
            set_impulses(state, lane, now);
        }
        std::mem::swap(before, now);
        self.repetitions += 1;
        self.reset_bodies(state, lane);
        true
    }

    /// Resets a lane's bodies to their initial state at this tick and keeps the impulses.
    fn reset_bodies(&self, state: &mut BatchState, lane: usize) {
        for (body, [x, y, angle, vx, vy, omega]) in state.bodies.iter_mut().zip(&self.start) {
            let m = &mut body.moving;
            (m.x[lane], m.y[lane], m.vx[lane], m.vy[lane], m.omega[lane]) = (*x, *y, *vx, *vy, *omega);
            body.angle[lane] = *angle;
            (body.bias_x[lane], body.bias_y[lane], body.rolling[lane]) = (0.0, 0.0, 0.0);
        }
        state.frames.iter_mut().for_each(|frame| frame.bias_omega[lane] = 0.0);
        state.all_contacts_mut().for_each(|contact| {
            (contact.last_touch[lane], contact.begins[lane]) = (NEVER_TOUCHED, 0.0);
        });
        state.start_tick[lane] = state.tick;
    }
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

fn dot(a: impl Iterator<Item = f64>, b: &[f64]) -> f64 {
    a.zip(b).map(|(a, b)| a * b).sum()
}
