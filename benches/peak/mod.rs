//! The rate at which this machine multiplies and adds f64 with a level's instructions: independent chains of
//! `x = x a + b`, enough of them to keep every unit busy, nothing loaded or stored.

use super::common::Clock;
use iplw::world::Level;

/// Operations a second, the best of several tries; `None` where the level has no such instruction.
pub fn flops(level: Level, fused: bool, clock: &Clock) -> Option<f64> {
    let (chains, per_round) = chains(level, fused)?;
    // Some tenths of a second: the clock of processor time may tick in hundredths.
    const ROUNDS: u64 = 200_000_000;
    let rate = |_| {
        let start = clock.seconds();
        chains(ROUNDS);
        ROUNDS as f64 * per_round / (clock.seconds() - start)
    };
    Some((0..5).map(rate).fold(0.0, f64::max))
}

/// What runs a number of rounds, and the operations of a round.
type Chains = (fn(u64), f64);

#[cfg(not(target_arch = "x86_64"))]
fn chains(_: Level, _: bool) -> Option<Chains> {
    None
}

#[cfg(target_arch = "x86_64")]
fn chains(level: Level, fused: bool) -> Option<Chains> {
    let fma = is_x86_feature_detected!("fma");
    // A multiplication and an addition for each lane of each chain.
    let per_round = |width: usize| (2 * width * COUNT) as f64;
    // SAFETY: each arm is taken only where the instructions have been found.
    match (level, fused) {
        (Level::Baseline, false) => Some((|n| unsafe { sse2(n) }, per_round(2))),
        (Level::Avx2, false) if level.available() => Some((|n| unsafe { avx2(n) }, per_round(4))),
        (Level::Avx2, true) if level.available() && fma => Some((|n| unsafe { avx2_fused(n) }, per_round(4))),
        (Level::Avx512, false) if level.available() => Some((|n| unsafe { avx512(n) }, per_round(8))),
        (Level::Avx512, true) if level.available() => Some((|n| unsafe { avx512_fused(n) }, per_round(8))),
        _ => None,
    }
}

/// Chains at once: two units, four cycles for each of two operations, and room in sixteen registers.
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
