//! A bump allocator, which frees only the last allocation: the memory of a thread.

use core::alloc::Layout;

/// The first free address of a thread's memory.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct Bump(pub *mut u8);

impl Bump {
    /// Takes memory.
    ///
    /// # Safety
    /// Enough memory follows the address.
    pub unsafe fn alloc(&mut self, layout: Layout) -> *mut u8 {
        unsafe {
            let at = self.0.add(self.0.align_offset(layout.align()));
            self.0 = at.add(layout.size());
            at
        }
    }

    /// Returns memory if it was taken last.
    ///
    /// # Safety
    /// It was taken with this layout.
    pub unsafe fn dealloc(&mut self, at: *mut u8, layout: Layout) {
        if unsafe { at.add(layout.size()) } == self.0 {
            self.0 = at;
        }
    }

    /// Changes the size of memory: in place if it was taken last.
    ///
    /// # Safety
    /// As for [`Bump::alloc`] and [`Bump::dealloc`].
    pub unsafe fn realloc(&mut self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        unsafe {
            if at.add(layout.size()) == self.0 {
                self.0 = at.add(size);
                return at;
            }
            if size <= layout.size() {
                return at;
            }
            let new = self.alloc(Layout::from_size_align_unchecked(size, layout.align()));
            core::ptr::copy_nonoverlapping(at, new, layout.size());
            new
        }
    }
}
