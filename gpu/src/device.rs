//! Entry points on a graphics processor, and the memory of a thread.
//!
//! A thread advances one rollout after the other. Its data lie in its own local memory, which the hardware interleaves between the
//! threads of a warp, so that neighbours read neighbouring addresses. There is an entry point for each size of that
//! memory; the program chooses the smallest that suffices (`lanes::gpu::arena`).

use core::alloc::{GlobalAlloc, Layout};
use core::arch::nvptx::{_block_dim_x, _block_idx_x, _thread_idx_x, trap};
use core::mem::MaybeUninit;

use crate::bump::Bump;
use crate::launch::{Launch, rollouts};

/// Free memory of each thread.
static mut ARENAS: *mut Bump = core::ptr::null_mut();

/// Index of the thread.
fn thread() -> usize {
    // SAFETY: reads of registers.
    unsafe { (_block_idx_x() * _block_dim_x() + _thread_idx_x()) as usize }
}

/// Runs rollouts with `WORDS` words of memory.
#[inline(always)]
unsafe fn enter<const WORDS: usize>(launch: *const Launch) {
    let mut arena = MaybeUninit::<[u64; WORDS]>::uninit();
    unsafe {
        let launch = &*launch;
        // Every thread writes the same address.
        ARENAS = launch.arenas;
        *launch.arenas.add(thread()) = Bump(arena.as_mut_ptr().cast());
        rollouts(launch);
    }
    // The memory is in use until here.
    core::hint::black_box(&mut arena);
}

macro_rules! entry_points {
    ($($name:ident $kilobytes:literal)*) => {$(
        /// # Safety
        /// See [`rollouts`].
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
        unsafe { (*ARENAS.add(thread())).alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        unsafe { (*ARENAS.add(thread())).dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        unsafe { (*ARENAS.add(thread())).realloc(at, layout, size) }
    }
}

#[global_allocator]
static ARENA: Arena = Arena;

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // SAFETY: ends the launch with an error that the program reports.
    unsafe { trap() }
}
