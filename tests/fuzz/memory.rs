//! Memory accounting by thread: peak, total and largest allocation of an execution.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system allocator with counters.
pub struct CountingAllocator;

#[global_allocator]
static MEMORY: CountingAllocator = CountingAllocator;

thread_local! {
    static BYTES_IN_USE: Cell<i64> = const { Cell::new(0) };
    static PEAK_BYTES: Cell<i64> = const { Cell::new(0) };
    static TOTAL_BYTES: Cell<u64> = const { Cell::new(0) };
}

/// Largest allocation of any thread, bytes.
static LARGEST_ALLOCATION: AtomicUsize = AtomicUsize::new(0);
/// Allocations up to this size are not compared with the largest, bytes.
const SMALL_ALLOCATION_BYTES: usize = 1 << 20;

/// Memory used by a thread since counting began, bytes.
#[derive(Clone, Copy, Debug)]
pub struct MemoryUse {
    /// Peak.
    pub most: i64,
    /// Total.
    pub taken: u64,
}

/// Runs `work` and counts the memory of its thread.
pub fn counted<T>(work: impl FnOnce() -> T) -> (T, MemoryUse) {
    let held = BYTES_IN_USE.get();
    PEAK_BYTES.set(held);
    TOTAL_BYTES.set(0);
    let done = work();
    (done, MemoryUse { most: PEAK_BYTES.get() - held, taken: TOTAL_BYTES.get() })
}

/// Largest allocation of any thread so far, bytes.
pub fn largest() -> usize {
    LARGEST_ALLOCATION.load(Ordering::Relaxed)
}

fn take(size: usize) {
    let held = BYTES_IN_USE.get() + size as i64;
    BYTES_IN_USE.set(held);
    PEAK_BYTES.set(PEAK_BYTES.get().max(held));
    TOTAL_BYTES.set(TOTAL_BYTES.get() + size as u64);
    if size > SMALL_ALLOCATION_BYTES {
        LARGEST_ALLOCATION.fetch_max(size, Ordering::Relaxed);
    }
}

// Thread-local cells with const initialisers neither allocate nor drop, so the allocator may use them.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        BYTES_IN_USE.set(BYTES_IN_USE.get() - layout.size() as i64);
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        BYTES_IN_USE.set(BYTES_IN_USE.get() - layout.size() as i64);
        take(size);
        unsafe { System.realloc(at, layout, size) }
    }
}
