//! Finding lanes in which nothing changes any more.
//!
//! A step is a function of positions, angles, speeds, bias speeds and cached impulses (and of the clock, where an
//! effect looks at it). If a step leaves all of them as they were, to the last bit, so does every step after it:
//! the remaining observations are copies, the same contacts carry the same bodies, and a goal that holds is held.

use super::batch::Batch;
use super::simd::V;
use crate::world::effect::LANES;

/// Steps between looks. Looking costs a few loads; finding rest late costs as many steps.
pub const LOOK_EVERY: f64 = 32.0;
/// Speed, m/s and rad/s, above which a body is certainly not at rest.
const SLOW: f64 = 1e-9;

/// Everything that a step depends on.
pub struct Snapshot {
    columns: Vec<V>,
    rolling: Vec<V>,
    born: V,
}

impl Snapshot {
    /// The state now, if any lane is slow enough to be worth it and no effect looks at the clock.
    pub fn of(batch: &Batch) -> Option<Snapshot> {
        let slow = |l: usize| {
            batch.bodies.iter().all(|b| {
                b.moving.vx[l].abs() < SLOW && b.moving.vy[l].abs() < SLOW && b.moving.omega[l].abs() < SLOW
            })
        };
        let worth = !batch.clocked && (0..LANES).any(|l| batch.is_used(l) && slow(l));
        worth.then(|| Snapshot {
            columns: columns(batch).collect(),
            rolling: batch.bodies.iter().map(|b| b.rolling).collect(),
            born: batch.born,
        })
    }

    /// If the lane's state is still the same: how many bodies the last step found carried.
    pub fn same(&self, batch: &Batch, lane: usize) -> Option<u32> {
        let kept = batch.is_used(lane)
            && self.born[lane] == batch.born[lane]
            && self.columns.iter().zip(columns(batch)).all(|(a, b)| a[lane].to_bits() == b[lane].to_bits());
        kept.then(|| {
            batch
                .bodies
                .iter()
                .zip(&self.rolling)
                .map(|(b, before)| b.rolling[lane] - before[lane])
                .sum::<f64>() as u32
        })
    }
}

fn columns(batch: &Batch) -> impl Iterator<Item = V> + '_ {
    let bodies = batch.bodies.iter().flat_map(|b| {
        let m = &b.moving;
        [V(m.x), V(m.y), V(m.vx), V(m.vy), V(m.omega), b.angle, b.bias_x, b.bias_y]
    });
    bodies.chain(batch.pairs.iter().flat_map(|p| [p.jn, p.jt]))
}
