//! Counters of simulated worlds that the next flush writes.

use std::collections::BTreeMap;

/// What is not written yet.
#[derive(Default)]
pub struct Pending {
    /// Counter and latents by world.
    pub worlds: BTreeMap<String, (u64, Option<String>)>,
    /// Notes taken, and how many of them are on the disk.
    pub noted: u64,
    pub written: u64,
}
