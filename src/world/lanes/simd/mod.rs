//! Eight lanes of f64 in registers of any width. The kernel is written once over [`Wide`]; instruction sets
//! differ only in the register type, and each operation is exactly rounded and never fused, so that all give
//! the same bits.

#![allow(unsafe_code, reason = "calls methods of registers, which read and write eight numbers")]

#[cfg(any(feature = "levels", test))]
mod eight;
mod plain;
mod register;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::ops::{Add, Deref, DerefMut, Mul, Sub};

#[cfg(any(feature = "levels", test))]
pub use eight::Eight;
pub use register::Register;

use crate::world::effect::LANES;

/// One number per lane, in memory.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
#[cfg_attr(not(kernel), repr(align(64)))]
pub struct V(pub [f64; LANES]);

impl V {
    /// The same number in every lane.
    #[inline]
    pub const fn all(value: f64) -> V {
        V([value; LANES])
    }
}

impl Deref for V {
    type Target = [f64; LANES];
    #[inline]
    fn deref(&self) -> &[f64; LANES] {
        &self.0
    }
}

impl DerefMut for V {
    #[inline]
    fn deref_mut(&mut self) -> &mut [f64; LANES] {
        &mut self.0
    }
}

/// [`LANES`] lanes in `N` registers.
#[derive(Clone, Copy)]
pub struct Wide<R, const N: usize>([R; N]);

/// A truth value per lane.
#[derive(Clone, Copy)]
pub struct Mask<R: Register, const N: usize>([R::Mask; N]);

macro_rules! lanewise {
    ($($(#[$doc:meta])* $name:ident),*) => {$(
        $(#[$doc])*
        #[inline(always)]
        pub fn $name(self, other: Self) -> Self {
            let mut out = self;
            for i in 0..N {
                // SAFETY: see `Register`.
                out.0[i] = unsafe { self.0[i].$name(other.0[i]) };
            }
            out
        }
    )*};
}

macro_rules! compare {
    ($($(#[$doc:meta])* $name:ident),*) => {$(
        $(#[$doc])*
        #[inline(always)]
        pub fn $name(self, other: Self) -> Mask<R, N> {
            // SAFETY: see `Register`.
            let mut out = [unsafe { self.0[0].$name(other.0[0]) }; N];
            for i in 1..N {
                // SAFETY: see `Register`.
                out[i] = unsafe { self.0[i].$name(other.0[i]) };
            }
            Mask(out)
        }
    )*};
}

impl<R: Register, const N: usize> Wide<R, N> {
    /// The lanes in memory.
    #[inline(always)]
    pub fn load(from: &[f64; LANES]) -> Self {
        const { assert!(R::WIDTH * N == LANES) };
        // SAFETY: see `Register`; the array holds WIDTH * N numbers.
        let mut out = [unsafe { R::load(from.as_ptr()) }; N];
        for (i, register) in out.iter_mut().enumerate() {
            // SAFETY: as above.
            *register = unsafe { R::load(from.as_ptr().add(i * R::WIDTH)) };
        }
        Wide(out)
    }

    /// Writes the lanes to memory.
    #[inline(always)]
    pub fn store(self, to: &mut [f64; LANES]) {
        const { assert!(R::WIDTH * N == LANES) };
        for i in 0..N {
            // SAFETY: see `Register`; the array holds WIDTH * N numbers.
            unsafe { self.0[i].store(to.as_mut_ptr().add(i * R::WIDTH)) };
        }
    }

    /// The same number in every lane.
    #[inline(always)]
    pub fn all(value: f64) -> Self {
        // SAFETY: see `Register`.
        Wide([unsafe { R::splat(value) }; N])
    }

    /// Square root.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        let mut out = self;
        for i in 0..N {
            // SAFETY: see `Register`.
            out.0[i] = unsafe { self.0[i].sqrt() };
        }
        out
    }

    /// 0 - self: a negation that never gives -0 from 0.
    #[inline(always)]
    pub fn minus(self) -> Self {
        Self::all(0.0) - self
    }

    /// Absolute value.
    #[inline(always)]
    pub fn abs(self) -> Self {
        self.above(self.minus())
    }

    lanewise!(
        /// Quotient.
        div,
        /// `self` where it is greater, else `other` (also for NaN).
        above,
        /// `self` where it is less, else `other` (also for NaN).
        below
    );
    compare!(
        /// self < other
        less,
        /// self <= other
        at_most
    );
}

macro_rules! operator {
    ($($operator:ident $name:ident),*) => {$(
        impl<R: Register, const N: usize> $operator for Wide<R, N> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                let mut out = self;
                for i in 0..N {
                    // SAFETY: see `Register`.
                    out.0[i] = unsafe { Register::$name(self.0[i], other.0[i]) };
                }
                out
            }
        }
    )*};
}
operator!(Add add, Sub sub, Mul mul);

impl<R: Register, const N: usize> Mask<R, N> {
    /// `yes` in lanes where true, `no` elsewhere.
    #[inline(always)]
    pub fn select(self, yes: Wide<R, N>, no: Wide<R, N>) -> Wide<R, N> {
        let mut out = no;
        for i in 0..N {
            // SAFETY: see `Register`.
            out.0[i] = unsafe { R::select(self.0[i], yes.0[i], no.0[i]) };
        }
        out
    }

    /// True where both are.
    #[inline(always)]
    pub fn and(self, other: Self) -> Self {
        let mut out = self;
        for i in 0..N {
            // SAFETY: see `Register`.
            out.0[i] = unsafe { R::and(self.0[i], other.0[i]) };
        }
        out
    }

    /// True where either is.
    #[inline(always)]
    pub fn or(self, other: Self) -> Self {
        let mut out = self;
        for i in 0..N {
            // SAFETY: see `Register`.
            out.0[i] = unsafe { R::or(self.0[i], other.0[i]) };
        }
        out
    }

    /// Whether true in any lane.
    #[inline(always)]
    pub fn any(self) -> bool {
        let mut all = self.0[0];
        for i in 1..N {
            // SAFETY: see `Register`.
            all = unsafe { R::or(all, self.0[i]) };
        }
        // SAFETY: see `Register`.
        unsafe { R::any(all) }
    }
}
