//! Memory that is given back: glibc's allocator keeps what was freed for whoever comes next, in eight arenas a core.
//!
//! A server that was busy once would look busy for ever. So there are as many arenas as cores, what is large is mapped by itself
//! and unmapped when freed (glibc would raise the size from which it does so with every large block it sees), and from time to
//! time what lies free is given back to the system. Elsewhere than on glibc nothing is done.

#![allow(unsafe_code, reason = "tells the C library's allocator how to keep memory and when to give it back")]

use std::thread::available_parallelism;

/// Sets the allocator up. Before any other thread is begun, so that none has an arena yet.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn set_up() {
    let arenas = available_parallelism().map_or(1, |n| n.get()).min(64) as i32;
    for (option, value) in [
        (libc::M_ARENA_MAX, arenas),
        (libc::M_MMAP_THRESHOLD, LARGE),
        (libc::M_TRIM_THRESHOLD, FREE_AT_THE_TOP),
    ] {
        // SAFETY: mallopt(3) changes a number of the allocator's, under its lock.
        unsafe { libc::mallopt(option, value) };
    }
}

/// Gives back what lies free.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn give_back() {
    // SAFETY: malloc_trim(3) gives whole pages that no block is in back to the system, under the allocator's lock.
    unsafe { libc::malloc_trim(0) };
}

/// Blocks from this size on are mapped by themselves, bytes. Smaller, and a step's lists would be; larger, and more stays.
const LARGE: i32 = 256 * 1024;
/// What may lie free at the end of the main arena, bytes.
const FREE_AT_THE_TOP: i32 = 1024 * 1024;

/// There is nothing to be set.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn set_up() {}

/// There is nothing to be done.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn give_back() {}
