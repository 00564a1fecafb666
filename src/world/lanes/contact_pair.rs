//! Detection of new contacts.

use super::simd::{Mask, Register, V, Wide};
use crate::world::contact_criteria::CONTACT_GAP_STEPS;

/// Tick of the last touch, and limit of travel, of a pair that has not been tested yet.
pub const NEVER_TOUCHED: f64 = -1e9;
/// Tolerance of distances travelled, m: far above rounding errors, far below relevant lengths.
pub const TRAVEL_TOLERANCE_M: f64 = 1e-6;

/// Two objects that may touch, and the time of their last touch.
#[derive(Clone)]
pub struct ContactPair {
    /// Index of a body.
    pub first: usize,
    /// Index of a body, or of a static after all bodies.
    pub other: usize,
    /// Tick of the last touch.
    pub last_touch: V,
    /// Lanes in which a contact begins in this step (1), and its normal velocity (negative: approach).
    pub begins: V,
    pub speed: V,
}

impl ContactPair {
    /// Two objects that have never touched.
    pub fn new(first: usize, other: usize) -> ContactPair {
        let none = V::all(0.0);
        ContactPair { first, other, last_touch: V::all(NEVER_TOUCHED), begins: none, speed: none }
    }

    /// Whether an object (a body, or a static after all bodies) is one of the two.
    pub fn is_of(&self, object: usize) -> bool {
        self.first == object || self.other == object
    }
}

/// Marks the lanes in which a contact begins; whether any does.
#[inline(always)]
pub fn begin<R: Register, const N: usize>(
    contact: &mut ContactPair,
    touching: Mask<R, N>,
    speed: Wide<R, N>,
    tick: f64,
) -> bool {
    let now = Wide::all(tick);
    let last = Wide::load(&contact.last_touch);
    touching.select(now, last).store(&mut contact.last_touch);
    let begins = touching.and(Wide::all(f64::from(CONTACT_GAP_STEPS)).less(now - last));
    if !begins.any() {
        return false;
    }
    begins.select(Wide::all(1.0), Wide::all(0.0)).store(&mut contact.begins);
    speed.store(&mut contact.speed);
    true
}
