//! What the ring is built on, in two twins: the machine's, and loom's, which tries every order of two threads' steps
//! and finds any access to a slot that is not handed over.

#[cfg(all(test, loom))]
pub(super) use loomed::*;
#[cfg(not(all(test, loom)))]
pub(super) use machine::*;

#[cfg(not(all(test, loom)))]
mod machine {
    use core::cell::UnsafeCell;
    pub(in crate::ring) use core::sync::atomic::{AtomicUsize, Ordering};

    /// Memory that two threads share by turns.
    #[derive(Debug)]
    pub(in crate::ring) struct Cell<T>(UnsafeCell<T>);

    impl<T: Copy> Cell<T> {
        /// Access to read; hold it as long as the slot is read.
        pub(in crate::ring) fn read(&self) -> Reading<T> {
            Reading(self.0.get())
        }

        /// Access to write; hold it as long as the slot is written.
        pub(in crate::ring) fn write(&self) -> Writing<T> {
            Writing(self.0.get())
        }
    }

    impl<T> Cell<T> {
        pub(in crate::ring) const fn new(value: T) -> Self {
            Self(UnsafeCell::new(value))
        }
    }

    #[derive(Debug)]
    pub(in crate::ring) struct Reading<T>(*const T);

    impl<T: Copy> Reading<T> {
        /// # Safety
        /// Nobody writes the cell meanwhile, and the cell is there.
        pub(in crate::ring) unsafe fn get(&self) -> T {
            // SAFETY: the caller's promise.
            unsafe { *self.0 }
        }
    }

    #[derive(Debug)]
    pub(in crate::ring) struct Writing<T>(*mut T);

    impl<T: Copy> Writing<T> {
        /// # Safety
        /// Nobody else touches the cell meanwhile, and the cell is there.
        pub(in crate::ring) unsafe fn set(self, value: T) {
            // SAFETY: the caller's promise.
            unsafe { *self.0 = value }
        }
    }

    macro_rules! const_unless_loom {
        ($(#[$doc:meta])* $visibility:vis fn $($rest:tt)*) => {
            $(#[$doc])* $visibility const fn $($rest)*
        };
    }
    pub(in crate::ring) use const_unless_loom;
}

#[cfg(all(test, loom))]
mod loomed {
    use loom::cell::{ConstPtr, MutPtr, UnsafeCell};
    pub(in crate::ring) use loom::sync::atomic::{AtomicUsize, Ordering};

    #[derive(Debug)]
    pub(in crate::ring) struct Cell<T>(UnsafeCell<T>);

    impl<T: Copy> Cell<T> {
        pub(in crate::ring) fn read(&self) -> Reading<T> {
            Reading(self.0.get())
        }

        pub(in crate::ring) fn write(&self) -> Writing<T> {
            Writing(self.0.get_mut())
        }
    }

    impl<T> Cell<T> {
        pub(in crate::ring) fn new(value: T) -> Self {
            Self(UnsafeCell::new(value))
        }
    }

    #[derive(Debug)]
    pub(in crate::ring) struct Reading<T>(ConstPtr<T>);

    impl<T: Copy> Reading<T> {
        pub(in crate::ring) unsafe fn get(&self) -> T {
            // SAFETY: loom checks that nobody writes it.
            unsafe { *self.0.deref() }
        }
    }

    #[derive(Debug)]
    pub(in crate::ring) struct Writing<T>(MutPtr<T>);

    impl<T: Copy> Writing<T> {
        pub(in crate::ring) unsafe fn set(self, value: T) {
            // SAFETY: loom checks that nobody else touches it.
            unsafe { *self.0.deref() = value }
        }
    }

    macro_rules! const_unless_loom {
        ($($item:tt)*) => { $($item)* };
    }
    pub(in crate::ring) use const_unless_loom;
}
