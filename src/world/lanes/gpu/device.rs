//! What runs rollouts that are written as numbers.

use std::sync::OnceLock;

use crate::error::{Error, Result};

/// Rollouts of one topology as numbers.
#[derive(Clone, Debug, Default)]
pub struct Work {
    /// Memory of a thread, kB: one of [`super::ARENA_SIZES_KB`].
    pub arena_kb: usize,
    /// The topology.
    pub topology: Vec<f64>,
    /// All rollouts, and where each begins; the last is the end.
    pub images: Vec<f64>,
    pub starts: Vec<usize>,
    /// Numbers of the output of each rollout.
    pub output_len: usize,
}

impl Work {
    /// Number of rollouts.
    pub fn rollouts(&self) -> usize {
        self.starts.len() - 1
    }
}

/// A graphics processor, or what stands for one in tests.
pub trait Accelerator: Sync {
    /// Name and memory, in words.
    fn description(&self) -> String;

    /// The outputs of all rollouts.
    ///
    /// # Errors
    /// If the device is out of memory or was lost.
    fn run(&self, work: &Work) -> Result<Vec<f64>>;
}

/// The graphics processor of this machine; an error says why there is none.
pub fn find() -> Result<&'static dyn Accelerator> {
    static FOUND: OnceLock<std::result::Result<Box<dyn Accelerator + Send>, String>> = OnceLock::new();
    match FOUND.get_or_init(open) {
        Ok(accelerator) => Ok(accelerator.as_ref()),
        Err(reason) => Err(Error::input(
            "engine",
            "\"gpu\"",
            format!("\"auto\", \"lanes\" or \"rapier\": this machine has no graphics processor that can be used ({reason})"),
        )),
    }
}

#[cfg(target_os = "linux")]
fn open() -> std::result::Result<Box<dyn Accelerator + Send>, String> {
    super::cuda::Cuda::open().map(|cuda| Box::new(cuda) as Box<dyn Accelerator + Send>)
}

#[cfg(not(target_os = "linux"))]
fn open() -> std::result::Result<Box<dyn Accelerator + Send>, String> {
    Err("only Linux is supported".into())
}
