//! Compiles the kernel for several instruction sets and selects one at run time.
//!
//! Each level is another copy of the whole kernel to compile. Programs need the baseline and the wider sets;
//! the others are for tests and benchmarks, enabled by the feature `levels`. In the library's unit tests the
//! baseline is a copy that is slow but quick to compile; results are the same.

#![allow(unsafe_code, reason = "calls code compiled for SIMD features that were detected on this machine")]

use super::batch::{self, Kernel};
use super::goal::GoalLanes;
use super::kernel;
#[cfg(feature = "levels")]
use super::operation_count::Counted;
#[cfg(any(feature = "levels", test))]
use super::simd::Eight;
use super::simd::Register;
use super::source::RolloutSource;
use super::state::BatchState;
#[cfg(all(target_arch = "x86_64", not(test)))]
use std::arch::x86_64::__m128d;
#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m256d, __m512d};
use std::marker::PhantomData;

/// Settings of a batch that do not change results.
#[derive(Clone, Copy, Debug)]
pub struct BatchSettings {
    /// Instruction set.
    pub level: SimdLevel,
    /// Whether a lane at rest is finished early by copying its state.
    pub end_at_rest: bool,
}

/// An instruction set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimdLevel {
    /// Scalar code: the baseline of machines other than x86-64. Available everywhere for tests.
    #[cfg(feature = "levels")]
    Plain,
    /// The baseline of the program; on x86-64, two lanes per register, elsewhere scalar code.
    Baseline,
    /// x86-64 with AVX2: four lanes per register.
    Avx2,
    /// x86-64 with AVX-512: eight lanes per register.
    Avx512,
    /// Scalar code with counted operations: see `operation_count`. Slow, and not in [`SimdLevel::ALL`].
    #[cfg(feature = "levels")]
    Counted,
}

impl SimdLevel {
    /// All levels in order of width.
    pub const ALL: &[SimdLevel] = &[
        #[cfg(feature = "levels")]
        SimdLevel::Plain,
        SimdLevel::Baseline,
        SimdLevel::Avx2,
        SimdLevel::Avx512,
    ];

    /// The widest level of this machine.
    pub fn best() -> SimdLevel {
        SimdLevel::ALL.iter().rev().copied().find(|l| l.available()).unwrap_or(SimdLevel::Baseline)
    }

    /// Whether this machine supports the level.
    pub fn available(self) -> bool {
        match self {
            SimdLevel::Baseline => true,
            #[cfg(feature = "levels")]
            SimdLevel::Plain | SimdLevel::Counted => true,
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
            }
            #[cfg(not(target_arch = "x86_64"))]
            SimdLevel::Avx2 | SimdLevel::Avx512 => false,
        }
    }
}

/// Integrates all rollouts of `source` at the level; an unsupported level falls back to the baseline.
pub fn run(source: &mut dyn RolloutSource, settings: BatchSettings) {
    let mut run = |instructions: &dyn Kernel| batch::run(source, settings.end_at_rest, instructions);
    match settings.level {
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx2 if SimdLevel::Avx2.available() => run(&Avx2),
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 if SimdLevel::Avx512.available() => run(&Avx512),
        #[cfg(feature = "levels")]
        SimdLevel::Plain => run(&PortableKernel::<Eight<f64>, 1>(PhantomData)),
        #[cfg(feature = "levels")]
        SimdLevel::Counted => run(&PortableKernel::<Eight<Counted>, 1>(PhantomData)),
        // Every x86-64 machine has 128-bit registers; elsewhere the compiler may vectorise the scalar
        // code.
        #[cfg(all(target_arch = "x86_64", not(test)))]
        _ => run(&PortableKernel::<__m128d, 4>(PhantomData)),
        #[cfg(not(any(target_arch = "x86_64", test)))]
        _ => run(&PortableKernel::<f64, 8>(PhantomData)),
        #[cfg(test)]
        _ => run(&PortableKernel::<Eight<f64>, 1>(PhantomData)),
    }
}

/// The kernel for instructions that every machine has.
struct PortableKernel<R, const N: usize>(PhantomData<R>);

impl<R: Register, const N: usize> Kernel for PortableKernel<R, N> {
    fn step(&self, state: &mut BatchState) {
        kernel::step::<R, N>(state);
    }
    fn update_goal(&self, goal: &mut GoalLanes, state: &mut BatchState) -> bool {
        goal.update::<R, N>(state)
    }
}

/// The kernel for instructions of some machines: used only after they were detected.
macro_rules! simd_kernel {
    ($name:ident, $features:literal, $register:ty, $count:literal) => {
        #[cfg(target_arch = "x86_64")]
        struct $name;

        #[cfg(target_arch = "x86_64")]
        impl Kernel for $name {
            fn step(&self, state: &mut BatchState) {
                #[target_feature(enable = $features)]
                fn step(state: &mut BatchState) {
                    kernel::step::<$register, $count>(state);
                }
                // SAFETY: `available` has detected the instructions on this machine.
                unsafe { step(state) }
            }
            fn update_goal(&self, goal: &mut GoalLanes, state: &mut BatchState) -> bool {
                #[target_feature(enable = $features)]
                fn update_goal(goal: &mut GoalLanes, state: &mut BatchState) -> bool {
                    goal.update::<$register, $count>(state)
                }
                // SAFETY: as above.
                unsafe { update_goal(goal, state) }
            }
        }
    };
}

simd_kernel!(Avx2, "avx2", __m256d, 2);
simd_kernel!(Avx512, "avx512f,avx512dq,avx512vl,avx512bw", __m512d, 1);
