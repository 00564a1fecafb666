//! Which instructions the kernel is compiled for: the same code several times, chosen at run time.
//!
//! Each level is a further copy of the whole kernel to compile. Programs need the baseline and what is wider; the others
//! are for tests and benchmarks, which switch them on by the feature `levels`.

#![allow(unsafe_code, reason = "calls what was compiled for instructions that this machine was seen to have")]

use super::batch::{self, Instructions};
#[cfg(feature = "levels")]
use super::count::Counted;
use super::feed::Feed;
use super::goal::GoalLanes;
use super::kernel;
#[cfg(feature = "levels")]
use super::simd::Eight;
use super::simd::Register;
use super::state::State;
#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m128d, __m256d, __m512d};
use std::marker::PhantomData;

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
    let mut run = |instructions: &dyn Instructions| batch::run(feed, settings.end_at_rest, instructions);
    match settings.level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 if Level::Avx2.available() => run(&Avx2),
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 if Level::Avx512.available() => run(&Avx512),
        #[cfg(feature = "levels")]
        Level::Plain => run(&Everywhere::<Eight<f64>, 1>(PhantomData)),
        #[cfg(feature = "levels")]
        Level::Counted => run(&Everywhere::<Eight<Counted>, 1>(PhantomData)),
        // Every x86-64 machine has 128-bit registers; elsewhere the compiler makes of single lanes what it can.
        #[cfg(target_arch = "x86_64")]
        _ => run(&Everywhere::<__m128d, 4>(PhantomData)),
        #[cfg(not(target_arch = "x86_64"))]
        _ => run(&Everywhere::<f64, 8>(PhantomData)),
    }
}

/// Instructions that every machine has.
struct Everywhere<R, const N: usize>(PhantomData<R>);

impl<R: Register, const N: usize> Instructions for Everywhere<R, N> {
    fn step(&self, state: &mut State) {
        kernel::step::<R, N>(state);
    }
    fn judge(&self, goal: &mut GoalLanes, state: &mut State) -> bool {
        goal.judge::<R, N>(state)
    }
}

/// Instructions of some machines: made only where they were found.
macro_rules! where_found {
    ($name:ident, $features:literal, $register:ty, $count:literal) => {
        #[cfg(target_arch = "x86_64")]
        struct $name;

        #[cfg(target_arch = "x86_64")]
        impl Instructions for $name {
            fn step(&self, state: &mut State) {
                #[target_feature(enable = $features)]
                fn step(state: &mut State) {
                    kernel::step::<$register, $count>(state);
                }
                // SAFETY: `available` has found the instructions on this machine.
                unsafe { step(state) }
            }
            fn judge(&self, goal: &mut GoalLanes, state: &mut State) -> bool {
                #[target_feature(enable = $features)]
                fn judge(goal: &mut GoalLanes, state: &mut State) -> bool {
                    goal.judge::<$register, $count>(state)
                }
                // SAFETY: as above.
                unsafe { judge(goal, state) }
            }
        }
    };
}

where_found!(Avx2, "avx2", __m256d, 2);
where_found!(Avx512, "avx512f,avx512dq,avx512vl,avx512bw", __m512d, 1);
