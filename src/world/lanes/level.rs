//! Which instructions the kernel is compiled for: the same code several times, chosen at run time.
//!
//! Each level is a further copy of the whole kernel to compile. Programs need the baseline and what is wider; the others
//! are for tests and benchmarks, which switch them on by the feature `levels`.

#![allow(unsafe_code, reason = "calls what was compiled for instructions that this machine was seen to have")]

use super::batch;
#[cfg(feature = "levels")]
use super::count::Counted;
use super::feed::Feed;
#[cfg(feature = "levels")]
use super::simd::Eight;
#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m128d, __m256d, __m512d};

/// How a batch is run; neither changes any result.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Instructions to use.
    pub level: Level,
    /// Whether a lane in which nothing changes any more is ended by filling in the rest.
    pub end_at_rest: bool,
}

/// A set of instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Single numbers: what the baseline is on machines other than x86-64. Here to be tested on every machine.
    #[cfg(feature = "levels")]
    Plain,
    /// What the whole program is compiled for; on x86-64, two lanes to a register, elsewhere single numbers.
    Baseline,
    /// x86-64 with AVX2: four lanes to a register.
    Avx2,
    /// x86-64 with AVX-512: eight lanes to a register.
    Avx512,
    /// Single numbers whose operations are counted: see `count`. Slow, and not among [`Level::ALL`].
    #[cfg(feature = "levels")]
    Counted,
}

impl Level {
    /// All levels, the widest last.
    pub const ALL: &[Level] = &[
        #[cfg(feature = "levels")]
        Level::Plain,
        Level::Baseline,
        Level::Avx2,
        Level::Avx512,
    ];

    /// The widest level of this machine.
    pub fn best() -> Level {
        Level::ALL.iter().rev().copied().find(|l| l.available()).unwrap_or(Level::Baseline)
    }

    /// Whether this machine has the level.
    pub fn available(self) -> bool {
        match self {
            Level::Baseline => true,
            #[cfg(feature = "levels")]
            Level::Plain | Level::Counted => true,
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Level::Avx2 | Level::Avx512 => false,
        }
    }
}

/// Integrates everything that `feed` holds, with the level's instructions; a level this machine lacks is taken for the
/// baseline.
pub fn run(feed: &mut dyn Feed, settings: Settings) {
    let end_at_rest = settings.end_at_rest;
    match settings.level {
        // SAFETY: `available` has just found the instructions on this machine.
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 if Level::Avx2.available() => unsafe { run_avx2(feed, end_at_rest) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 if Level::Avx512.available() => unsafe { run_avx512(feed, end_at_rest) },
        #[cfg(feature = "levels")]
        Level::Plain => batch::run::<Eight<f64>, 1>(feed, end_at_rest),
        #[cfg(feature = "levels")]
        Level::Counted => batch::run::<Eight<Counted>, 1>(feed, end_at_rest),
        _ => run_baseline(feed, end_at_rest),
    }
}

/// Every x86-64 machine has 128-bit registers; elsewhere the compiler makes of single lanes what it can.
fn run_baseline(feed: &mut dyn Feed, end_at_rest: bool) {
    #[cfg(target_arch = "x86_64")]
    batch::run::<__m128d, 4>(feed, end_at_rest);
    #[cfg(not(target_arch = "x86_64"))]
    batch::run::<f64, 8>(feed, end_at_rest);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2(feed: &mut dyn Feed, end_at_rest: bool) {
    batch::run::<__m256d, 2>(feed, end_at_rest);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw")]
fn run_avx512(feed: &mut dyn Feed, end_at_rest: bool) {
    batch::run::<__m512d, 1>(feed, end_at_rest);
}
