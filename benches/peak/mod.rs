//! Peak rate of f64 multiplications and additions with a level's instructions: independent chains of `x = x a + b`, enough to occupy
//! all execution units, without loads and stores.

use super::common::Clock;
use iplw::world::SimdLevel;

/// Operations per second, the best of several repetitions; `None` if the level has no such instruction.
pub fn flops(level: SimdLevel, fused: bool, clock: &Clock) -> Option<f64> {
    let (chains, per_round) = chains(level, fused)?;
    // A few tenths of a second, since the processor-time clock may have a resolution of 10 ms.
    const ROUNDS: u64 = 200_000_000;
    let rate = |_| {
        let start = clock.seconds();
        chains(ROUNDS);
        ROUNDS as f64 * per_round / (clock.seconds() - start)
    };
    Some((0..5).map(rate).fold(0.0, f64::max))
}

/// Function that runs a number of rounds, and the operations per round.
type Chains = (fn(u64), f64);

#[cfg(not(target_arch = "x86_64"))]
fn chains(_: SimdLevel, _: bool) -> Option<Chains> {
    None
}

#[cfg(target_arch = "x86_64")]
fn chains(level: SimdLevel, fused: bool) -> Option<Chains> {
    let fma = is_x86_feature_detected!("fma");
    // One multiplication and one addition per lane and chain.
    let per_round = |width: usize| (2 * width * COUNT) as f64;
    // SAFETY: each arm is taken only where the instructions have been found.
    match (level, fused) {
        (SimdLevel::Baseline, false) => Some((|n| unsafe { sse2(n) }, per_round(2))),
        (SimdLevel::Avx2, false) if level.available() => Some((|n| unsafe { avx2(n) }, per_round(4))),
        (SimdLevel::Avx2, true) if level.available() && fma => {
            Some((|n| unsafe { avx2_fused(n) }, per_round(4)))
        }
        (SimdLevel::Avx512, false) if level.available() => Some((|n| unsafe { avx512(n) }, per_round(8))),
        (SimdLevel::Avx512, true) if level.available() => {
            Some((|n| unsafe { avx512_fused(n) }, per_round(8)))
        }
        _ => None,
    }
}

/// Number of chains: two units with four cycles of latency for each of two operations need 16; 12 fit into sixteen registers.
#[cfg(target_arch = "x86_64")]
const COUNT: usize = 12;

#[cfg(target_arch = "x86_64")]
macro_rules! chains {
    ($($name:ident $features:literal $splat:ident |$x:ident, $a:ident, $b:ident| $next:expr;)*) => {$(
        #[target_feature(enable = $features)]
        fn $name(rounds: u64) {
            use std::arch::x86_64::*;
            use std::hint::black_box;
            let ($a, $b) = ($splat(black_box(0.999)), $splat(black_box(0.001)));
            let mut all = [$splat(black_box(1.0)); COUNT];
            for _ in 0..rounds {
                for $x in &mut all {
                    let value = *$x;
                    *$x = { let $x = value; $next };
                }
            }
            black_box(all);
        }
    )*};
}

#[cfg(target_arch = "x86_64")]
chains! {
    sse2 "sse2" _mm_set1_pd |x, a, b| _mm_add_pd(_mm_mul_pd(x, a), b);
    avx2 "avx2" _mm256_set1_pd |x, a, b| _mm256_add_pd(_mm256_mul_pd(x, a), b);
    avx2_fused "avx2,fma" _mm256_set1_pd |x, a, b| _mm256_fmadd_pd(x, a, b);
    avx512 "avx512f" _mm512_set1_pd |x, a, b| _mm512_add_pd(_mm512_mul_pd(x, a), b);
    avx512_fused "avx512f" _mm512_set1_pd |x, a, b| _mm512_fmadd_pd(x, a, b);
}
