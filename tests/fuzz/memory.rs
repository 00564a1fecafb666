//! How much memory a thread asks for: what an execution takes at once, in all and in one piece.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's memory, counted.
pub struct Counted;

#[global_allocator]
static MEMORY: Counted = Counted;

thread_local! {
    static HELD: Cell<i64> = const { Cell::new(0) };
    static MOST: Cell<i64> = const { Cell::new(0) };
    static TAKEN: Cell<u64> = const { Cell::new(0) };
}

/// Largest piece that any thread ever asked for, bytes.
static LARGEST: AtomicUsize = AtomicUsize::new(0);
/// Pieces up to this are not compared with the largest, bytes.
const SMALL: usize = 1 << 20;

/// What a thread has taken since it began to count, bytes.
#[derive(Clone, Copy, Debug)]
pub struct Used {
    /// Most at a time.
    pub most: i64,
    /// In all.
    pub taken: u64,
}

/// Does `work`, and counts what its thread takes meanwhile.
pub fn counted<T>(work: impl FnOnce() -> T) -> (T, Used) {
    let held = HELD.get();
    MOST.set(held);
    TAKEN.set(0);
    let done = work();
    (done, Used { most: MOST.get() - held, taken: TAKEN.get() })
}

/// Largest piece that any thread has asked for so far, bytes.
pub fn largest() -> usize {
    LARGEST.load(Ordering::Relaxed)
}

fn take(size: usize) {
    let held = HELD.get() + size as i64;
    HELD.set(held);
    MOST.set(MOST.get().max(held));
    TAKEN.set(TAKEN.get() + size as u64);
    if size > SMALL {
        LARGEST.fetch_max(size, Ordering::Relaxed);
    }
}

// Cells of numbers made at compile time neither take memory nor are dropped: they may be used here.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        HELD.set(HELD.get() - layout.size() as i64);
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        HELD.set(HELD.get() - layout.size() as i64);
        take(size);
        unsafe { System.realloc(at, layout, size) }
    }
}
