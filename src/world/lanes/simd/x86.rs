//! Registers of x86-64: two, four and eight lanes.

#![allow(unsafe_code, reason = "instructions that not every machine has")]
// Mask arithmetic is plain integers for one of the three.
#![allow(unused_unsafe)]

use super::register::Register;
use std::arch::x86_64::*;

macro_rules! register {
    ($register:ty, $width:literal, $mask:ty,
     $load:ident $store:ident $splat:ident $add:ident $sub:ident $mul:ident $div:ident $sqrt:ident
     $max:ident $min:ident,
     |$a:ident, $b:ident| $less:expr, $at_most:expr,
     |$m:ident, $yes:ident, $no:ident| $select:expr,
     |$p:ident, $q:ident| $and:expr, $or:expr, $any:expr) => {
        // SAFETY: the type determines the required instructions; the pointers are used as promised.
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
