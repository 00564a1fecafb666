//! Buffered counters of simulated worlds.

use std::collections::BTreeMap;

/// Counters that are not written yet.
#[derive(Default)]
pub struct WorldWriteBuffer {
    /// Counter by world.
    pub worlds: BTreeMap<String, u64>,
    /// Number of updates, and how many of them are written.
    pub noted: u64,
    pub written: u64,
}
