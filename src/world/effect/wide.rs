//! Numbers of all lanes at once, by the widest instructions that there are.

#![allow(unsafe_code, reason = "calls what was compiled for instructions that this machine was seen to have")]

use super::LANES;

/// A number of every lane; the same bits as one after the other. It pays where the numbers are worked out without branches.
#[inline]
pub fn lanes(of: impl Fn(usize) -> f64) -> [f64; LANES] {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") {
        // SAFETY: the machine has both, as was just seen.
        return unsafe { widest(of) };
    }
    each(of)
}

/// A loop, and no `std::array::from_fn`: what that goes through is compiled by itself, for any machine, where it is not inlined.
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
