//! A register of eight scalar lanes whose operations are calls: slow, but much less code to compile than
//! eight unrolled operations. For levels that are only compared with.

#![allow(unsafe_code, reason = "the same methods as for registers of several lanes")]

use super::register::Register;

/// Eight single lanes.
#[derive(Clone, Copy)]
pub struct Eight<S>([S; 8]);

macro_rules! each {
    ($($name:ident),*) => {$(
        #[inline(never)]
        unsafe fn $name(self, other: Self) -> Self {
            // SAFETY: the single register's own conditions, which are this one's.
            Eight(std::array::from_fn(|i| unsafe { self.0[i].$name(other.0[i]) }))
        }
    )*};
}

macro_rules! compare {
    ($($name:ident),*) => {$(
        #[inline(never)]
        unsafe fn $name(self, other: Self) -> [bool; 8] {
            // SAFETY: as above.
            std::array::from_fn(|i| unsafe { self.0[i].$name(other.0[i]) })
        }
    )*};
}

// SAFETY: needs what the single register needs; eight numbers are read and written as promised.
unsafe impl<S: Register<Mask = bool>> Register for Eight<S> {
    const WIDTH: usize = {
        assert!(S::WIDTH == 1);
        8
    };
    type Mask = [bool; 8];

    #[inline(never)]
    unsafe fn load(from: *const f64) -> Self {
        Eight(std::array::from_fn(|i| unsafe { S::load(from.add(i)) }))
    }
    #[inline(never)]
    unsafe fn store(self, to: *mut f64) {
        for (i, single) in self.0.into_iter().enumerate() {
            unsafe { single.store(to.add(i)) };
        }
    }
    #[inline(never)]
    unsafe fn splat(value: f64) -> Self {
        Eight([unsafe { S::splat(value) }; 8])
    }
    each!(add, sub, mul, div, above, below);
    compare!(less, at_most);
    #[inline(never)]
    unsafe fn sqrt(self) -> Self {
        Eight(self.0.map(|single| unsafe { single.sqrt() }))
    }
    #[inline(never)]
    unsafe fn select(mask: [bool; 8], yes: Self, no: Self) -> Self {
        Eight(std::array::from_fn(|i| unsafe { S::select(mask[i], yes.0[i], no.0[i]) }))
    }
    #[inline(never)]
    unsafe fn and(a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] & b[i])
    }
    #[inline(never)]
    unsafe fn or(a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] | b[i])
    }
    #[inline(never)]
    unsafe fn any(mask: [bool; 8]) -> bool {
        mask.contains(&true)
    }
}
