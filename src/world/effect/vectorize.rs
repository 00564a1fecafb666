//! Vectorised evaluation over all lanes, with the widest SIMD instructions of the machine.

#![allow(unsafe_code, reason = "calls code compiled for SIMD features that were detected on this machine")]

use super::LANES;

/// A number for every lane; the same bits as a scalar loop. Useful for computations without branches.
#[inline]
pub fn map_lanes(of: impl Fn(usize) -> f64) -> [f64; LANES] {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") {
        // SAFETY: the detection above found both features.
        return unsafe { widest(of) };
    }
    each(of)
}

/// A loop instead of `std::array::from_fn`, whose internals are compiled for the baseline where they are not
/// inlined.
#[inline(always)]
fn each(of: impl Fn(usize) -> f64) -> [f64; LANES] {
    let mut out = [0.0; LANES];
    for (lane, out) in out.iter_mut().enumerate() {
        *out = of(lane);
    }
    out
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq")]
fn widest(of: impl Fn(usize) -> f64) -> [f64; LANES] {
    each(of)
}
