//! Entry points on a graphics processor, and the memory of a thread.
//!
//! A thread advances one rollout. Its data lie in its own local memory, which the hardware interleaves between the
//! threads of a warp, so that neighbours read neighbouring addresses. There is an entry point for each size of that
//! memory; the program chooses the smallest that suffices (`lanes::gpu::arena`).

use core::alloc::{GlobalAlloc, Layout};
use core::arch::nvptx::{_block_dim_x, _block_idx_x, _thread_idx_x, trap};
use core::mem::MaybeUninit;

use crate::bump::Bump;
use crate::run::{Output, run};

/// What a launch works on, in device memory.
#[repr(C)]
pub struct Launch {
    /// Numbers of the topology, and how many.
    topology: *const f64,
    topology_len: usize,
    /// Images of all rollouts, and where each begins; one more than rollouts.
    images: *const f64,
    starts: *const usize,
    rollouts: usize,
    /// Outputs of all rollouts, each of so many numbers.
    outputs: *mut f64,
    output_len: usize,
    /// Room for an address for each thread.
    arenas: *mut Bump,
}

/// Free memory of each thread.
static mut ARENAS: *mut Bump = core::ptr::null_mut();

/// Index of the thread.
fn thread() -> usize {
    // SAFETY: reads of registers.
    unsafe { (_block_idx_x() * _block_dim_x() + _thread_idx_x()) as usize }
}

/// Runs the rollout of this thread with `WORDS` words of memory.
#[inline(always)]
unsafe fn enter<const WORDS: usize>(launch: *const Launch) {
    let mut arena = MaybeUninit::<[u64; WORDS]>::uninit();
    let launch = unsafe { &*launch };
    let index = thread();
    if index >= launch.rollouts {
        return;
    }
    unsafe {
        // Every thread writes the same address.
        ARENAS = launch.arenas;
        *launch.arenas.add(index) = Bump(arena.as_mut_ptr().cast());
        rollout(launch, index);
    }
    // The memory is in use until here.
    core::hint::black_box(&mut arena);
}

/// # Safety
/// `launch` describes memory of the device, and `index` is less than its number of rollouts.
#[inline(never)]
unsafe fn rollout(launch: &Launch, index: usize) {
    unsafe {
        let topology = core::slice::from_raw_parts(launch.topology, launch.topology_len);
        let (from, to) = (*launch.starts.add(index), *launch.starts.add(index + 1));
        let image = core::slice::from_raw_parts(launch.images.add(from), to - from);
        let numbers = launch.outputs.add(index * launch.output_len);
        let numbers = core::slice::from_raw_parts_mut(numbers, launch.output_len);
        run(topology, image, &mut Output::new(numbers));
    }
}

macro_rules! entry_points {
    ($($name:ident $kilobytes:literal)*) => {$(
        /// # Safety
        /// See [`rollout`].
        #[unsafe(no_mangle)]
        pub unsafe extern "ptx-kernel" fn $name(launch: *const Launch) {
            unsafe { enter::<{ $kilobytes * 128 }>(launch) }
        }
    )*};
}
entry_points!(rollout_8 8 rollout_16 16 rollout_48 48 rollout_128 128);

/// Takes memory from the thread's own.
struct Arena;

// SAFETY: every thread has its own memory. The program chooses an entry point with enough of it.
unsafe impl GlobalAlloc for Arena {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        unsafe { (*ARENAS.add(thread())).take(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        unsafe { (*ARENAS.add(thread())).give_back(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        unsafe { (*ARENAS.add(thread())).resize(at, layout, size) }
    }
}

#[global_allocator]
static ARENA: Arena = Arena;

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // SAFETY: ends the launch with an error that the program reports.
    unsafe { trap() }
}
