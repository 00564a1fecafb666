//! The memory of a thread of a graphics processor, on the processor: while it is in use, all memory of the thread comes
//! from it, with the kernel's allocator.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use iplw_gpu::Bump;

/// Upper bound of what the kernel can take.
const BYTES: usize = 1 << 20;

thread_local! {
    /// Start and free part of the memory in use, and the most that was taken.
    static MEMORY: Cell<Option<(usize, Bump)>> = const { Cell::new(None) };
    static MOST: Cell<usize> = const { Cell::new(0) };
}

struct ThreadMemory;

#[global_allocator]
static ALLOCATOR: ThreadMemory = ThreadMemory;

/// Runs `work` with a thread's memory; returns the bytes that it took at most.
pub fn bytes_taken(work: impl FnOnce()) -> usize {
    let memory: Vec<u64> = vec![0; BYTES / 8];
    let start = memory.as_ptr() as usize;
    MOST.set(0);
    MEMORY.set(Some((start, Bump(start as *mut u8))));
    work();
    MEMORY.set(None);
    MOST.get()
}

/// `change` of the memory in use; `None` if the system's is.
fn with<T>(change: impl FnOnce(&mut Bump) -> T) -> Option<T> {
    let (start, mut free) = MEMORY.get()?;
    let result = change(&mut free);
    let taken = free.0 as usize - start;
    if taken > BYTES {
        std::process::abort();
    }
    MEMORY.set(Some((start, free)));
    MOST.set(MOST.get().max(taken));
    Some(result)
}

// SAFETY: the system's allocator, or that of the kernel within memory that is checked to suffice.
unsafe impl GlobalAlloc for ThreadMemory {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        with(|free| unsafe { free.alloc(layout) }).unwrap_or_else(|| unsafe { System.alloc(layout) })
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        with(|free| unsafe { free.dealloc(at, layout) })
            .unwrap_or_else(|| unsafe { System.dealloc(at, layout) });
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        with(|free| unsafe { free.realloc(at, layout, size) })
            .unwrap_or_else(|| unsafe { System.realloc(at, layout, size) })
    }
}
