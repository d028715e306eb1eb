//! Memory for what is large and made anew: all events of a recording, a tensor.
//!
//! The first touch of a fresh 4 KiB page costs some 2 µs, more than decoding the 512 events that fit in it. On pages
//! of 2 MiB it is 1 ns an event.

use std::io;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

use bytemuck::Pod;
use memmap2::MmapMut;

/// An array of zeroes to fill, on large pages where the machine has them.
///
/// ```
/// use lobula_core::Event;
/// let mut events = lobula_formats::LargeArray::<Event>::zeroed(1_000_000)?;
/// events[0] = Event::new(1, 2, 3, lobula_core::Polarity::On);
/// events.truncate(1);
/// assert_eq!(events.len(), 1);
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct LargeArray<T> {
    map: MmapMut,
    len: usize,
    element: PhantomData<T>,
}

impl<T: Pod> LargeArray<T> {
    /// An array of `len` zeroes. Memory is taken as it is touched.
    ///
    /// # Errors
    /// Those of the system: there is no room for it.
    pub fn zeroed(len: usize) -> io::Result<Self> {
        let bytes = len.checked_mul(size_of::<T>()).ok_or(io::ErrorKind::OutOfMemory)?;
        let map = MmapMut::map_anon(bytes.max(1))?;
        ask_for_large_pages(&map);
        Ok(Self { map, len, element: PhantomData })
    }

    /// Keeps the first `len` elements; more than there are keeps all.
    pub fn truncate(&mut self, len: usize) {
        self.len = self.len.min(len);
    }
}

/// A kernel that has none gives small ones, which is no error.
#[cfg(target_os = "linux")]
fn ask_for_large_pages(map: &MmapMut) {
    let _ = map.advise(memmap2::Advice::HugePage);
}

#[cfg(not(target_os = "linux"))]
fn ask_for_large_pages(_: &MmapMut) {}

impl<T: Pod> Deref for LargeArray<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        let bytes = self.map.get(..self.len * size_of::<T>()).unwrap_or_default();
        bytemuck::cast_slice(bytes)
    }
}

impl<T: Pod> DerefMut for LargeArray<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        let bytes = self.map.get_mut(..self.len * size_of::<T>()).unwrap_or_default();
        bytemuck::cast_slice_mut(bytes)
    }
}

impl<T: Pod> AsRef<[T]> for LargeArray<T> {
    fn as_ref(&self) -> &[T] {
        self
    }
}

impl<T: Pod> AsMut<[T]> for LargeArray<T> {
    fn as_mut(&mut self) -> &mut [T] {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holds_what_is_written_and_starts_as_zeroes() {
        let mut array = LargeArray::<u32>::zeroed(3_000_000).unwrap();
        assert!(array.iter().all(|element| *element == 0));
        array[2_999_999] = 7;
        assert_eq!(array.last(), Some(&7));
        array.truncate(4_000_000);
        assert_eq!(array.len(), 3_000_000);
        array.truncate(0);
        assert!(array.is_empty());
    }

    #[test]
    fn sizes_of_no_machine_are_errors() {
        assert!(LargeArray::<u64>::zeroed(usize::MAX).is_err());
        assert!(LargeArray::<u64>::zeroed(usize::MAX / 16).is_err());
        assert!(LargeArray::<u64>::zeroed(0).unwrap().is_empty());
    }
}
