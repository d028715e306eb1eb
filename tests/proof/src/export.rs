//! Functions whose callers are unknown, and what their arguments become.

/// Makes an [`Export`] of a function.
#[macro_export]
macro_rules! export {
    ($function:expr) => {
        $crate::export::Export::new($function as *const ())
    };
}

/// A function that anyone may call.
pub struct Export(*const ());

// SAFETY: the address of a function.
unsafe impl Sync for Export {}

impl Export {
    pub const fn new(function: *const ()) -> Self {
        Self(function)
    }

    pub const fn pointer(&self) -> *const () {
        self.0
    }
}

/// # Safety
/// `len` elements are there.
pub unsafe fn slice<'a, T>(first: *const T, len: usize) -> &'a [T] {
    // SAFETY: the caller's promise.
    unsafe { core::slice::from_raw_parts(first, len) }
}

/// # Safety
/// `len` elements are there, and nobody else's.
pub unsafe fn slice_mut<'a, T>(first: *mut T, len: usize) -> &'a mut [T] {
    // SAFETY: the caller's promise.
    unsafe { core::slice::from_raw_parts_mut(first, len) }
}
