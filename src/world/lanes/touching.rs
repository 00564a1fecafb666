//! When two things begin to touch, whatever they are.

use super::simd::{Mask, Register, V, Wide};
use crate::world::record::APART_STEPS;

/// Tick of the last touch, and limit of travel, of a pair not yet looked at.
pub const NEVER_TOUCHED: f64 = -1e9;
/// m; covers the rounding of travelled ways, far below what matters and far above what rounds off.
pub const HAIR: f64 = 1e-6;

/// Two things that may touch, and when they did.
#[derive(Clone)]
pub struct Met {
    /// Index of a body.
    pub first: usize,
    /// Index of a body, or of a static after all bodies.
    pub other: usize,
    /// Tick of the last touch.
    pub last_touch: V,
    /// Lanes that begin to touch (1), and the normal speed (negative: approach), in this step.
    pub begins: V,
    pub speed: V,
}

impl Met {
    /// Two that have never touched.
    pub fn new(first: usize, other: usize) -> Met {
        let none = V::all(0.0);
        Met { first, other, last_touch: V::all(NEVER_TOUCHED), begins: none, speed: none }
    }

    /// Whether a thing (a body, or a static after all bodies) is one of the two.
    pub fn is_of(&self, thing: usize) -> bool {
        self.first == thing || self.other == thing
    }
}

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
