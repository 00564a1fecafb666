//! A single-lane register that counts operations: the arithmetic cost of a step, for benchmarks.
//!
//! Operations are counted per lane as executed, whether their result is used or not, because they take time
//! either way. Scalar code (effects, continuous collision detection, observation) is not counted.

#![allow(unsafe_code, reason = "the same methods as for registers of several lanes")]

use std::cell::Cell;

use super::simd::Register;

/// Numbers of single-lane operations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OperationCounts {
    /// Additions, subtractions and multiplications.
    pub simple: u64,
    /// Divisions and square roots.
    pub slow: u64,
    /// Minima, maxima, comparisons and selections.
    pub choices: u64,
    /// Numbers loaded from and stored to memory.
    pub moves: u64,
}

thread_local! {
    static COUNTED: Cell<OperationCounts> = const { Cell::new(OperationCounts { simple: 0, slow: 0, choices: 0, moves: 0 }) };
}

/// The counts of rayon's threads since the last call.
pub fn operations() -> OperationCounts {
    let counted = rayon::broadcast(|_| COUNTED.take());
    counted.into_iter().fold(OperationCounts::default(), |a, b| OperationCounts {
        simple: a.simple + b.simple,
        slow: a.slow + b.slow,
        choices: a.choices + b.choices,
        moves: a.moves + b.moves,
    })
}

/// An f64 that counts its operations.
#[derive(Clone, Copy)]
pub struct Counted(f64);

#[inline(never)]
fn count(what: impl Fn(&mut OperationCounts)) {
    let mut counted = COUNTED.get();
    what(&mut counted);
    COUNTED.set(counted);
}

macro_rules! counted {
    ($field:ident: $($name:ident)*) => {$(
        #[inline(always)]
        unsafe fn $name(self, other: Self) -> Self {
            count(|c| c.$field += 1);
            // SAFETY: f64 needs no special instructions.
            Counted(unsafe { Register::$name(self.0, other.0) })
        }
    )*};
}

// SAFETY: as for f64, whose methods do the work.
unsafe impl Register for Counted {
    const WIDTH: usize = 1;
    type Mask = bool;

    #[inline(always)]
    unsafe fn load(from: *const f64) -> Self {
        count(|c| c.moves += 1);
        Counted(unsafe { f64::load(from) })
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f64) {
        count(|c| c.moves += 1);
        unsafe { self.0.store(to) }
    }
    #[inline(always)]
    unsafe fn splat(value: f64) -> Self {
        Counted(value)
    }
    counted!(simple: add sub mul);
    counted!(slow: div);
    counted!(choices: above below);
    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        count(|c| c.slow += 1);
        Counted(self.0.sqrt())
    }
    #[inline(always)]
    unsafe fn less(self, other: Self) -> bool {
        count(|c| c.choices += 1);
        self.0 < other.0
    }
    #[inline(always)]
    unsafe fn at_most(self, other: Self) -> bool {
        count(|c| c.choices += 1);
        self.0 <= other.0
    }
    #[inline(always)]
    unsafe fn select(mask: bool, yes: Self, no: Self) -> Self {
        count(|c| c.choices += 1);
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
