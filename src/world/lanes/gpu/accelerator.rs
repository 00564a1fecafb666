//! Runs rollouts that are written as numbers.

use crate::error::Result;

/// Rollouts of one topology as numbers.
#[derive(Clone, Debug, Default)]
pub struct RolloutImages {
    /// Memory of a thread, kB: one of [`super::arena::ARENA_SIZES_KB`].
    pub arena_kb: usize,
    /// The topology.
    pub topology: Vec<f64>,
    /// All rollouts, and where each begins; the last is the end.
    pub images: Vec<f64>,
    pub starts: Vec<usize>,
    /// Numbers of the output of each rollout.
    pub output_len: usize,
}

impl RolloutImages {
    /// Number of rollouts.
    pub fn rollouts(&self) -> usize {
        self.starts.len() - 1
    }
}

/// A graphics processor, or what stands for one in tests.
pub trait Accelerator: Sync {
    /// The outputs of all rollouts.
    ///
    /// # Errors
    /// If the device is out of memory or was lost.
    fn run(&self, work: &RolloutImages) -> Result<Vec<f64>>;

    /// Number of rollouts that it runs at the same time, with this thread memory.
    fn capacity(&self, arena_kb: usize) -> usize;
}
