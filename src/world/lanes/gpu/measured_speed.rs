//! Whether an accelerator is faster than the CPU: measured at its first use, for each size of a thread's memory.
//!
//! Only the time that a batch takes depends on it: results have the same bits on both.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::time::Duration;

use crate::sync::lock;

/// The measurements, and whether the accelerator failed: then it is not used again unless it is asked for.
#[derive(Default)]
pub struct MeasuredSpeed(Mutex<Measured>);

#[derive(Default)]
struct Measured {
    /// Whether the accelerator is faster, by thread memory in kB.
    faster: BTreeMap<usize, bool>,
    failed: bool,
}

impl MeasuredSpeed {
    /// Whether the accelerator is faster for rollouts with this thread memory; `None` if it was not measured.
    pub fn accelerator_is_faster(&self, arena_kb: usize) -> Option<bool> {
        let measured = lock(&self.0);
        if measured.failed { Some(false) } else { measured.faster.get(&arena_kb).copied() }
    }

    /// Stores a measurement: the time of rollouts on the accelerator and on the CPU, and their number.
    pub fn store(&self, arena_kb: usize, accelerator: (Duration, usize), cpu: (Duration, usize)) -> bool {
        let per_rollout = |(time, count): (Duration, usize)| time.as_secs_f64() / count as f64;
        let faster = per_rollout(accelerator) < per_rollout(cpu);
        lock(&self.0).faster.insert(arena_kb, faster);
        faster
    }

    /// Notes that the accelerator failed.
    pub fn set_failed(&self) {
        lock(&self.0).failed = true;
    }
}
