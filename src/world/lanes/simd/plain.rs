//! Registers of one lane: scalar code, available on every processor.

#![allow(unsafe_code, reason = "the same methods as for registers of several lanes")]

use super::register;

// SAFETY: needs no special instructions; the pointers are read and written as promised.
unsafe impl register::Register for f64 {
    const WIDTH: usize = 1;
    type Mask = bool;
    #[inline(always)]
    unsafe fn load(from: *const f64) -> f64 {
        unsafe { *from }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f64) {
        unsafe { *to = self }
    }
    #[inline(always)]
    unsafe fn splat(value: f64) -> f64 {
        value
    }
    #[inline(always)]
    unsafe fn add(self, other: f64) -> f64 {
        self + other
    }
    #[inline(always)]
    unsafe fn sub(self, other: f64) -> f64 {
        self - other
    }
    #[inline(always)]
    unsafe fn mul(self, other: f64) -> f64 {
        self * other
    }
    #[inline(always)]
    unsafe fn div(self, other: f64) -> f64 {
        self / other
    }
    #[inline(always)]
    unsafe fn sqrt(self) -> f64 {
        square_root(self)
    }
    #[inline(always)]
    unsafe fn above(self, other: f64) -> f64 {
        if self > other { self } else { other }
    }
    #[inline(always)]
    unsafe fn below(self, other: f64) -> f64 {
        if self < other { self } else { other }
    }
    #[inline(always)]
    unsafe fn less(self, other: f64) -> bool {
        self < other
    }
    #[inline(always)]
    unsafe fn at_most(self, other: f64) -> bool {
        self <= other
    }
    #[inline(always)]
    unsafe fn select(mask: bool, yes: f64, no: f64) -> f64 {
        if mask { yes } else { no }
    }
    #[inline(always)]
    unsafe fn and(a: bool, b: bool) -> bool {
        a & b
    }
    #[inline(always)]
    unsafe fn or(a: bool, b: bool) -> bool {
        a | b
    }
    #[inline(always)]
    unsafe fn any(mask: bool) -> bool {
        mask
    }
}

/// Outside of the trait, whose method has the same name.
#[inline(always)]
fn square_root(x: f64) -> f64 {
    x.sqrt()
}
