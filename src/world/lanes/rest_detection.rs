//! Detects lanes at rest.
//!
//! A step is a function of positions, angles, velocities, bias velocities and cached impulses (and of time,
//! if an effect depends on it). If a step leaves all of them unchanged to the last bit, so does every later
//! step: the remaining observations are copies, the same contacts support the same bodies, and a goal that
//! holds is held.

use super::simd::V;
use super::state::BatchState;
use crate::world::effect::LANES;

/// Steps between tests. A test costs a few loads; late detection costs up to as many steps.
pub const REST_CHECK_INTERVAL_STEPS: u64 = 32;
/// Speed, m/s and rad/s, above which a body is certainly not at rest.
const MAX_REST_SPEED_M_S: f64 = 1e-9;

/// All quantities that a step depends on, if they were taken after the last step. Its memory is reused.
#[derive(Default)]
pub struct StepSnapshot {
    taken: bool,
    columns: Vec<V>,
    /// Pairs of outlines with a manifold.
    contacts: Vec<usize>,
    rolling: Vec<V>,
    start_tick: V,
}

impl StepSnapshot {
    /// A snapshot with memory for every state of these bodies and pairs.
    pub fn with_capacity(state: &BatchState) -> StepSnapshot {
        let (bodies, near) = (state.bodies.len(), state.near.len());
        StepSnapshot {
            columns: Vec::with_capacity(9 * bodies + 2 * state.pairs.len() + 6 * near),
            contacts: Vec::with_capacity(near),
            rolling: Vec::with_capacity(bodies),
            ..StepSnapshot::default()
        }
    }

    /// Takes a snapshot of the state, if any lane is slow enough and no effect depends on time.
    pub fn take(&mut self, state: &BatchState, used: impl Fn(usize) -> bool) {
        let slow = |l: usize| {
            state.bodies.iter().all(|b| {
                b.moving.vx[l].abs() < MAX_REST_SPEED_M_S
                    && b.moving.vy[l].abs() < MAX_REST_SPEED_M_S
                    && b.moving.omega[l].abs() < MAX_REST_SPEED_M_S
            })
        };
        self.taken = !state.clocked && (0..LANES).any(|l| used(l) && slow(l));
        if self.taken {
            self.columns.clear();
            self.columns.extend(columns(state));
            self.contacts.clear();
            self.contacts.extend(contacts(state));
            self.rolling.clear();
            self.rolling.extend(state.bodies.iter().map(|b| b.rolling));
            self.start_tick = state.start_tick;
        }
    }

    /// Whether there is one.
    pub fn is_taken(&self) -> bool {
        self.taken
    }

    /// Discards it.
    pub fn forget(&mut self) {
        self.taken = false;
    }

    /// If the lane's rollout and state are unchanged: the number of bodies that were supported in the
    /// last step.
    pub fn same(&self, state: &BatchState, lane: usize) -> Option<u32> {
        let kept = self.start_tick[lane] == state.start_tick[lane]
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

fn columns(state: &BatchState) -> impl Iterator<Item = V> + '_ {
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

fn contacts(state: &BatchState) -> impl Iterator<Item = usize> + '_ {
    state.near.iter().enumerate().filter(|(_, near)| near.slot.is_some()).map(|(i, _)| i)
}
