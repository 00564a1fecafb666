//! Rollouts as the program passes them to a device.

use core::sync::atomic::{AtomicU32, Ordering};

use crate::bump::Bump;
use crate::run::{Output, run};

/// Rollouts in memory, and room for their outputs.
#[repr(C)]
pub struct Launch {
    /// Numbers of the topology, and how many.
    pub topology: *const f64,
    pub topology_len: usize,
    /// Images of all rollouts, and where each begins; one more than rollouts.
    pub images: *const f64,
    pub starts: *const usize,
    pub rollouts: usize,
    /// Outputs of all rollouts, each of so many numbers.
    pub outputs: *mut f64,
    pub output_len: usize,
    /// Room for an address for each thread.
    pub arenas: *mut Bump,
    /// Number of rollouts that threads have taken.
    pub taken: *const AtomicU32,
}

/// Runs rollouts until none is left.
///
/// # Safety
/// `launch` describes memory of the device.
#[inline(never)]
pub unsafe fn rollouts(launch: &Launch) {
    let topology = unsafe { core::slice::from_raw_parts(launch.topology, launch.topology_len) };
    run(topology, || {
        let index = unsafe { &*launch.taken }.fetch_add(1, Ordering::Relaxed) as usize;
        if index >= launch.rollouts {
            return None;
        }
        // SAFETY: no other thread has this index.
        unsafe {
            let (from, to) = (*launch.starts.add(index), *launch.starts.add(index + 1));
            let image = core::slice::from_raw_parts(launch.images.add(from), to - from);
            let numbers = launch.outputs.add(index * launch.output_len);
            Some((image, Output::new(core::slice::from_raw_parts_mut(numbers, launch.output_len))))
        }
    });
}
