//! Eight lanes of f64 in registers of any width. The kernel is written once over [`Wide`]; which register it
//! stands on is the only difference between instruction sets, and each operation here is exactly rounded and
//! never fused, so that all give the same bits.

use std::ops::{Add, Deref, DerefMut, Mul, Sub};

use crate::world::effect::LANES;

/// One number per lane, in memory.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub struct V(pub [f64; LANES]);

impl V {
    /// The same number in every lane.
    pub const fn all(value: f64) -> V {
        V([value; LANES])
    }
}

impl Deref for V {
    type Target = [f64; LANES];
    fn deref(&self) -> &[f64; LANES] {
        &self.0
    }
}

impl DerefMut for V {
    fn deref_mut(&mut self) -> &mut [f64; LANES] {
        &mut self.0
    }
}

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

    /// 0 - self: like a negation, but never -0 from 0.
    #[inline(always)]
    pub fn minus(self) -> Self {
        Self::all(0.0) - self
    }

    /// Size.
    #[inline(always)]
    pub fn size(self) -> Self {
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

// SAFETY: needs no special instructions; the pointers are read and written as promised.
unsafe impl Register for f64 {
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
        f64::sqrt(self)
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

// Mask arithmetic is plain integers for one of the three.
#[allow(unused_unsafe)]
#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::Register;
    use std::arch::x86_64::*;

    macro_rules! register {
        ($register:ty, $width:literal, $mask:ty,
         $load:ident $store:ident $splat:ident $add:ident $sub:ident $mul:ident $div:ident $sqrt:ident
         $max:ident $min:ident,
         |$a:ident, $b:ident| $less:expr, $at_most:expr,
         |$m:ident, $yes:ident, $no:ident| $select:expr,
         |$p:ident, $q:ident| $and:expr, $or:expr, $any:expr) => {
            // SAFETY: what instructions are needed is said by the type; the pointers are used as promised.
            unsafe impl Register for $register {
                const WIDTH: usize = $width;
                type Mask = $mask;
                #[inline(always)]
                unsafe fn load(from: *const f64) -> Self {
                    unsafe { $load(from) }
                }
                #[inline(always)]
                unsafe fn store(self, to: *mut f64) {
                    unsafe { $store(to, self) }
                }
                #[inline(always)]
                unsafe fn splat(value: f64) -> Self {
                    unsafe { $splat(value) }
                }
                #[inline(always)]
                unsafe fn add(self, other: Self) -> Self {
                    unsafe { $add(self, other) }
                }
                #[inline(always)]
                unsafe fn sub(self, other: Self) -> Self {
                    unsafe { $sub(self, other) }
                }
                #[inline(always)]
                unsafe fn mul(self, other: Self) -> Self {
                    unsafe { $mul(self, other) }
                }
                #[inline(always)]
                unsafe fn div(self, other: Self) -> Self {
                    unsafe { $div(self, other) }
                }
                #[inline(always)]
                unsafe fn sqrt(self) -> Self {
                    unsafe { $sqrt(self) }
                }
                #[inline(always)]
                unsafe fn above(self, other: Self) -> Self {
                    unsafe { $max(self, other) }
                }
                #[inline(always)]
                unsafe fn below(self, other: Self) -> Self {
                    unsafe { $min(self, other) }
                }
                #[inline(always)]
                unsafe fn less(self, other: Self) -> $mask {
                    let ($a, $b) = (self, other);
                    unsafe { $less }
                }
                #[inline(always)]
                unsafe fn at_most(self, other: Self) -> $mask {
                    let ($a, $b) = (self, other);
                    unsafe { $at_most }
                }
                #[inline(always)]
                unsafe fn select($m: $mask, $yes: Self, $no: Self) -> Self {
                    unsafe { $select }
                }
                #[inline(always)]
                unsafe fn and($p: $mask, $q: $mask) -> $mask {
                    unsafe { $and }
                }
                #[inline(always)]
                unsafe fn or($p: $mask, $q: $mask) -> $mask {
                    unsafe { $or }
                }
                #[inline(always)]
                unsafe fn any($p: $mask) -> bool {
                    unsafe { $any }
                }
            }
        };
    }

    // max and min of these give the second operand for NaN and for zeros of unlike sign, as `above` does.
    register!(__m128d, 2, __m128d,
        _mm_loadu_pd _mm_storeu_pd _mm_set1_pd _mm_add_pd _mm_sub_pd _mm_mul_pd _mm_div_pd _mm_sqrt_pd
        _mm_max_pd _mm_min_pd,
        |a, b| _mm_cmplt_pd(a, b), _mm_cmple_pd(a, b),
        |m, yes, no| _mm_or_pd(_mm_and_pd(m, yes), _mm_andnot_pd(m, no)),
        |p, q| _mm_and_pd(p, q), _mm_or_pd(p, q), _mm_movemask_pd(p) != 0);
    register!(__m256d, 4, __m256d,
        _mm256_loadu_pd _mm256_storeu_pd _mm256_set1_pd _mm256_add_pd _mm256_sub_pd _mm256_mul_pd _mm256_div_pd
        _mm256_sqrt_pd _mm256_max_pd _mm256_min_pd,
        |a, b| _mm256_cmp_pd::<_CMP_LT_OQ>(a, b), _mm256_cmp_pd::<_CMP_LE_OQ>(a, b),
        |m, yes, no| _mm256_blendv_pd(no, yes, m),
        |p, q| _mm256_and_pd(p, q), _mm256_or_pd(p, q), _mm256_movemask_pd(p) != 0);
    register!(__m512d, 8, __mmask8,
        _mm512_loadu_pd _mm512_storeu_pd _mm512_set1_pd _mm512_add_pd _mm512_sub_pd _mm512_mul_pd _mm512_div_pd
        _mm512_sqrt_pd _mm512_max_pd _mm512_min_pd,
        |a, b| _mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b), _mm512_cmp_pd_mask::<_CMP_LE_OQ>(a, b),
        |m, yes, no| _mm512_mask_blend_pd(m, no, yes),
        |p, q| p & q, p | q, p != 0);
}
