//! What pointers from C become.

use core::mem::MaybeUninit;

/// Memory of the caller's for an object, as large and as aligned as the header says.
#[repr(C, align(8))]
pub struct Opaque<const WORDS: usize>([MaybeUninit<u64>; WORDS]);

impl<const WORDS: usize> Opaque<WORDS> {
    const fn holds<T>() -> bool {
        size_of::<T>() <= size_of::<Self>() && align_of::<T>() <= align_of::<Self>()
    }

    /// # Safety
    /// `at` is such memory.
    pub unsafe fn write<T>(at: *mut Self, value: T) {
        const { assert!(Self::holds::<T>(), "the header gives this object too little memory") };
        // SAFETY: the caller's promise, and it is large enough.
        unsafe { at.cast::<T>().write(value) }
    }

    /// # Safety
    /// `at` holds a `T` that [`write`](Self::write) put there, and nobody else uses it.
    pub unsafe fn get<'a, T>(at: *mut Self) -> &'a mut T {
        const { assert!(Self::holds::<T>(), "the header gives this object too little memory") };
        // SAFETY: the caller's promise.
        unsafe { &mut *at.cast::<T>() }
    }
}

/// # Safety
/// `len` elements are there, or `len` is 0.
pub unsafe fn slice<'a, T>(first: *const T, len: usize) -> &'a [T] {
    if len == 0 || first.is_null() {
        return &[];
    }
    // SAFETY: the caller's promise.
    unsafe { core::slice::from_raw_parts(first, len) }
}

/// # Safety
/// `len` elements are there, and nobody else's, or `len` is 0.
pub unsafe fn slice_mut<'a, T>(first: *mut T, len: usize) -> &'a mut [T] {
    if len == 0 || first.is_null() {
        return &mut [];
    }
    // SAFETY: the caller's promise.
    unsafe { core::slice::from_raw_parts_mut(first, len) }
}
