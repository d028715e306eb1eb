//! One brightness change at one pixel, the unit of everything.

use bytemuck::{Pod, Zeroable};

/// Direction of a brightness change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
#[repr(u8)]
pub enum Polarity {
    /// Darker.
    Off = 0,
    /// Brighter.
    On = 1,
}

impl Polarity {
    /// The polarity of a bit: 1 is ON, as in every Prophesee format.
    #[inline]
    pub const fn from_bit(bit: u16) -> Self {
        if bit & 1 == 1 { Self::On } else { Self::Off }
    }
}

/// One brightness change at one pixel: 8 bytes of plain data, the same in registers, rings and shared memory.
///
/// Time is the sensor's, in µs, modulo 2^32; the [`Block`](crate::Block) around it knows the full 64 bits.
///
/// ```
/// use lobula_core::{Event, Polarity};
/// let event = Event::new(1_000_000, 640, 360, Polarity::On);
/// assert_eq!((event.t(), event.x(), event.y(), event.polarity()), (1_000_000, 640, 360, Polarity::On));
/// ```
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash, Pod, Zeroable)]
#[repr(C)]
pub struct Event {
    t: u32,
    x: u16,
    y_on: u16,
}

impl Event {
    /// Bit of the second coordinate's word that holds the polarity.
    pub const ON_BIT: u16 = 0x8000;

    /// An event; of `y` the low 15 bits are kept, which is more than any sensor has.
    #[inline]
    pub const fn new(t: u32, x: u16, y: u16, polarity: Polarity) -> Self {
        Self { t, x, y_on: (y & !Self::ON_BIT) | ((polarity as u16) << 15) }
    }

    /// An event that is one word already: `t` in its lowest 32 bits, then `x` in 16, `y` in 15, and 1 for ON. For loops
    /// that a compiler is to vectorise.
    ///
    /// ```
    /// use lobula_core::{Event, Polarity};
    /// let word = 7 | 640 << 32 | 360 << 48 | 1 << 63;
    /// assert_eq!(Event::from_word(word), Event::new(7, 640, 360, Polarity::On));
    /// ```
    #[inline(always)]
    pub fn from_word(word: u64) -> Self {
        bytemuck::cast(packed::pack(word as u32, (word >> 32) as u32))
    }

    /// The event as one word, as [`from_word`](Self::from_word) takes it.
    ///
    /// ```
    /// use lobula_core::{Event, Polarity};
    /// assert_eq!(Event::new(7, 640, 360, Polarity::On).word(), 7 | 640 << 32 | 360 << 48 | 1 << 63);
    /// ```
    #[inline(always)]
    pub fn word(self) -> u64 {
        packed::unpack(bytemuck::cast(self))
    }

    /// The same event at another time.
    #[inline]
    pub const fn with_t(self, t: u32) -> Self {
        Self { t, ..self }
    }

    /// Sensor time in µs, modulo 2^32.
    #[inline]
    pub const fn t(self) -> u32 {
        self.t
    }

    /// Column, from the left.
    #[inline]
    pub const fn x(self) -> u16 {
        self.x
    }

    /// Row, from the top.
    #[inline]
    pub const fn y(self) -> u16 {
        self.y_on & !Self::ON_BIT
    }

    /// Whether the pixel became brighter.
    #[inline]
    pub const fn is_on(self) -> bool {
        self.y_on & Self::ON_BIT != 0
    }

    /// All bits set for ON, none for OFF: to select without a branch, since no branch predictor knows the polarity
    /// of the next event.
    #[inline(always)]
    pub(crate) const fn on_mask(self) -> u32 {
        ((self.y_on as i16) >> 15) as i32 as u32
    }

    /// Direction of the change.
    #[inline]
    pub const fn polarity(self) -> Polarity {
        Polarity::from_bit(self.y_on >> 15)
    }
}

/// An event as one word of the machine, for loops that build many: `bytemuck::cast` makes it an [`Event`] and costs
/// nothing.
pub(crate) mod packed {
    const LITTLE: bool = cfg!(target_endian = "little");
    /// What moves a packed event one column to the right.
    pub(crate) const COLUMN: u64 = 1 << if LITTLE { 32 } else { 16 };

    /// Of its time and its pixel: x in bits 0..15, y in 16..30, 1 in 31 for ON.
    #[inline(always)]
    pub(crate) const fn pack(t: u32, pixel: u32) -> u64 {
        let (t, pixel) = (t as u64, pixel as u64);
        if LITTLE { t | pixel << 32 } else { t << 32 | (pixel & 0xFFFF) << 16 | pixel >> 16 }
    }

    /// Of a packed event, time in bits 0..31 and pixel above, on every machine.
    #[inline(always)]
    pub(crate) const fn unpack(packed: u64) -> u64 {
        if LITTLE { packed } else { packed >> 32 | (packed >> 16 & 0xFFFF) << 32 | packed << 48 }
    }
}

impl core::fmt::Debug for Event {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "t={} x={} y={} p={}", self.t, self.x, self.y(), self.is_on() as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layout_is_eight_plain_bytes() {
        let event = Event::new(0x0403_0201, 0x0605, 0x0007, Polarity::On);
        assert_eq!(bytemuck::bytes_of(&event), [1, 2, 3, 4, 5, 6, 7, 0x80]);
    }

    #[test]
    fn a_packed_event_is_the_event() {
        let packed = packed::pack(0x0403_0201, 0x8007_0605);
        let event = Event::new(0x0403_0201, 0x0605, 0x0007, Polarity::On);
        assert_eq!(bytemuck::cast::<u64, Event>(packed), event);
        assert_eq!(event.word(), 0x0403_0201 | 0x8007_0605 << 32);
        let right = Event::new(0x0403_0201, 0x0608, 0x0007, Polarity::On);
        assert_eq!(bytemuck::cast::<u64, Event>(packed + 3 * packed::COLUMN), right);
    }
}
