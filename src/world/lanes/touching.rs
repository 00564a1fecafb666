//! When two things begin to touch, whatever they are.

use super::simd::{Mask, Register, Wide};
use super::state::Met;
use crate::world::record::APART_STEPS;

/// m; covers the rounding of travelled ways, far below what matters and far above what rounds off.
pub const HAIR: f64 = 1e-6;
/// Marks the lanes that begin to touch; whether any does.
#[inline(always)]
pub fn begin<R: Register, const N: usize>(
    met: &mut Met,
    touching: Mask<R, N>,
    speed: Wide<R, N>,
    tick: f64,
) -> bool {
    let now = Wide::all(tick);
    let last = Wide::load(&met.last_touch);
    touching.select(now, last).store(&mut met.last_touch);
    let begins = touching.and(Wide::all(f64::from(APART_STEPS)).less(now - last));
    if !begins.any() {
        return false;
    }
    begins.select(Wide::all(1.0), Wide::all(0.0)).store(&mut met.begins);
    speed.store(&mut met.speed);
    true
}
