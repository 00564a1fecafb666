//! Settings of glibc's allocator, which otherwise keeps freed memory in eight arenas a core.
//!
//! Without them a server would keep its peak memory. There are as many arenas as cores, large blocks are mapped individually and
//! unmapped when freed (glibc would raise that threshold with every large block freed), and free memory is returned to the system
//! periodically. On other platforms nothing is done.

#![allow(unsafe_code, reason = "calls mallopt and malloc_trim of the C library")]

use std::thread::available_parallelism;

/// Configures the allocator. Call before other threads start, so that none has an arena yet.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn configure() {
    let arenas = available_parallelism().map_or(1, |n| n.get()).min(64) as i32;
    for (option, value) in [
        (libc::M_ARENA_MAX, arenas),
        (libc::M_MMAP_THRESHOLD, MMAP_THRESHOLD_BYTES),
        (libc::M_TRIM_THRESHOLD, TRIM_THRESHOLD_BYTES),
    ] {
        // SAFETY: mallopt(3) sets a parameter of the allocator, under its lock.
        unsafe { libc::mallopt(option, value) };
    }
}

/// Returns free memory to the system.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn return_free_memory() {
    // SAFETY: malloc_trim(3) returns whole free pages to the system, under the allocator's lock.
    unsafe { libc::malloc_trim(0) };
}

/// Blocks of this size and above are mapped individually, bytes. Smaller: a step's lists would be mapped; larger: more memory stays.
const MMAP_THRESHOLD_BYTES: i32 = 256 * 1024;
/// Free memory kept at the top of the main arena, bytes.
const TRIM_THRESHOLD_BYTES: i32 = 1024 * 1024;

/// Nothing to configure.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn configure() {}

/// Nothing to return.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn return_free_memory() {}
