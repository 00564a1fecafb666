//! The operations of a SIMD register.

#![allow(unsafe_code, reason = "instructions that not every machine has, and reads and writes at a pointer")]

/// A register of a few lanes.
///
/// # Safety
/// Implementations may use instructions that a machine lacks: their methods must only run within functions
/// compiled for them on machines that have them, which `level` sees to. `load` and `store` touch the
/// [`Register::WIDTH`] numbers from the pointer on.
pub unsafe trait Register: Copy {
    /// Lanes in the register.
    const WIDTH: usize;
    /// A truth value per lane.
    type Mask: Copy;
    unsafe fn load(from: *const f64) -> Self;
    unsafe fn store(self, to: *mut f64);
    unsafe fn splat(value: f64) -> Self;
    unsafe fn add(self, other: Self) -> Self;
    unsafe fn sub(self, other: Self) -> Self;
    unsafe fn mul(self, other: Self) -> Self;
    unsafe fn div(self, other: Self) -> Self;
    unsafe fn sqrt(self) -> Self;
    /// `self` where it is greater, else `other` (also for NaN).
    unsafe fn above(self, other: Self) -> Self;
    /// `self` where it is less, else `other` (also for NaN).
    unsafe fn below(self, other: Self) -> Self;
    unsafe fn less(self, other: Self) -> Self::Mask;
    unsafe fn at_most(self, other: Self) -> Self::Mask;
    unsafe fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    unsafe fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    unsafe fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    unsafe fn any(mask: Self::Mask) -> bool;
}
