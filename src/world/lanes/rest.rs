//! Finding lanes in which nothing changes any more.
//!
//! A step is a function of positions, angles, speeds, bias speeds and cached impulses (and of the clock, where an
//! effect looks at it). If a step leaves all of them as they were, to the last bit, so does every step after it:
//! the remaining observations are copies, the same contacts carry the same bodies, and a goal that holds is held.

use super::simd::V;
use super::state::State;
use crate::world::effect::LANES;

/// Steps between looks. Looking costs a few loads; finding rest late costs as many steps.
pub const LOOK_EVERY: u64 = 32;
/// Speed, m/s and rad/s, above which a body is certainly not at rest.
const SLOW: f64 = 1e-9;

/// Everything that a step depends on.
pub struct Snapshot {
    columns: Vec<V>,
    /// Pairs of outlines with a contact.
    contacts: Vec<usize>,
    rolling: Vec<V>,
    born: V,
}

impl Snapshot {
    /// The state now, if any lane is slow enough to be worth it and no effect looks at the clock.
    pub fn of(state: &State, used: impl Fn(usize) -> bool) -> Option<Snapshot> {
        let slow = |l: usize| {
            state.bodies.iter().all(|b| {
                b.moving.vx[l].abs() < SLOW && b.moving.vy[l].abs() < SLOW && b.moving.omega[l].abs() < SLOW
            })
        };
        let worth = !state.clocked && (0..LANES).any(|l| used(l) && slow(l));
        worth.then(|| Snapshot {
            columns: kept(state),
            contacts: contacts(state).collect(),
            rolling: state.bodies.iter().map(|b| b.rolling).collect(),
            born: state.born,
        })
    }

    /// If the lane's rollout and state are still the same: how many bodies the last step found carried.
    pub fn same(&self, state: &State, lane: usize) -> Option<u32> {
        let kept = self.born[lane] == state.born[lane]
            && self.contacts.iter().copied().eq(contacts(state))
            && self.columns.iter().zip(columns(state)).all(|(a, b)| a[lane].to_bits() == b[lane].to_bits());
        kept.then(|| {
            state
                .bodies
                .iter()
                .zip(&self.rolling)
                .map(|(b, before)| b.rolling[lane] - before[lane])
                .sum::<f64>() as u32
        })
    }
}

/// [`columns`] at once: how many there are is not known to their iterator, and to move them while they are collected costs more than
/// they do.
fn kept(state: &State) -> Vec<V> {
    let points = state.near.iter().filter(|near| near.slot.is_some()).count();
    let most = 9 * state.bodies.len() + 2 * state.pairs.len() + 6 * points;
    let mut all = Vec::with_capacity(most);
    all.extend(columns(state));
    all
}

fn columns(state: &State) -> impl Iterator<Item = V> + '_ {
    let bodies = state.bodies.iter().flat_map(|b| {
        let m = &b.moving;
        [V(m.x), V(m.y), V(m.vx), V(m.vy), V(m.omega), b.angle, b.bias_x, b.bias_y]
    });
    let pairs = state.pairs.iter().flat_map(|p| [p.jn, p.jt]);
    let points = state.near.iter().filter_map(|near| Some(&state.manifolds[near.slot?].points));
    let contacts = points.flat_map(|points| points.iter().flat_map(|p| [p.id, p.jn, p.jt]));
    let biases = state.frames.iter().map(|f| f.bias_omega);
    bodies.chain(pairs).chain(contacts).chain(biases)
}

fn contacts(state: &State) -> impl Iterator<Item = usize> + '_ {
    state.near.iter().enumerate().filter(|(_, near)| near.slot.is_some()).map(|(i, _)| i)
}
