//! What goes before every packet and tensor in shared memory: plain data of fixed size, the same for every language.
//!
//! 256 bytes each, little-endian, no padding, the reserve zeroed, the version first. A field is never moved; what is new
//! takes from the reserve.

use bytemuck::{Pod, Zeroable};
use core::ops::{BitOr, BitOrAssign};
use iceoryx2::prelude::ZeroCopySend;
use lobula_core::representation::Dtype;
use lobula_core::{Event, Geometry};

/// Version of everything a client and a daemon must agree on: headers, names, quality of service, control.
pub const ABI: u32 = 1;

/// Properties of a packet, as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Flags(pub u32);

impl Flags {
    /// Bytes or events were lost right before or within this packet.
    pub const GAP: Self = Self(1);
    /// Not live: a recording is played.
    pub const REPLAY: Self = Self(1 << 1);
    /// Filters have thinned the events.
    pub const FILTERED: Self = Self(1 << 2);
    /// The sensor's clock was started anew right before or within this packet.
    pub const CLOCK_STEP: Self = Self(1 << 3);
    /// The daemon is overloaded and thins the events or skips views.
    pub const OVERLOAD: Self = Self(1 << 4);
    /// The source has ended; nothing follows in this generation but packets with this flag.
    pub const END: Self = Self(1 << 5);

    const NAMES: [(Self, &'static str); 6] = [
        (Self::GAP, "gap"),
        (Self::REPLAY, "replay"),
        (Self::FILTERED, "filtered"),
        (Self::CLOCK_STEP, "clock_step"),
        (Self::OVERLOAD, "overload"),
        (Self::END, "end"),
    ];

    /// Whether all of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The names of the flags that are set.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMES.into_iter().filter(move |(flag, _)| self.contains(*flag)).map(|(_, name)| name)
    }
}

impl BitOr for Flags {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for Flags {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

/// Where the time went: host time in ns of CLOCK_MONOTONIC. 0: not known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable, ZeroCopySend)]
#[repr(C)]
pub struct Stamps {
    /// When the newest bytes ought to have arrived, by the schedule of a paced replay or simulation.
    pub due_ns: u64,
    /// When the last of the newest bytes arrived from the source.
    pub arrived_ns: u64,
    /// When they were decoded and filtered.
    pub decoded_ns: u64,
    /// When the packet was handed to the clients.
    pub published_ns: u64,
}

/// How sensor time maps to host time: `host_ns = offset_ns + sensor_us * 1000 * (1 + skew_ppb / 1e9)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable, ZeroCopySend)]
#[repr(C)]
pub struct ClockMap {
    /// Number of the map; another one after each restart of the sensor's clock. 0: no map is known.
    pub id: u32,
    /// Standard deviation in ns.
    pub sigma_ns: u32,
    /// Host time at sensor time 0, in ns of CLOCK_MONOTONIC.
    pub offset_ns: i64,
    /// By how many parts in 10^9 the sensor's clock is slow.
    pub skew_ppb: i32,
    /// Zero.
    pub reserved: u32,
}

/// Ledger of bytes: `input = decoded + faulty + lost`, at any time.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Pod,
    Zeroable,
    ZeroCopySend,
    serde::Serialize,
    serde::Deserialize,
)]
#[repr(C)]
pub struct ByteLedger {
    /// Bytes the source gave (those of a word that is not complete yet count when it is).
    pub input: u64,
    /// Bytes of well-formed words.
    pub decoded: u64,
    /// Bytes of malformed words.
    pub faulty: u64,
    /// Bytes known to have been lost before decoding.
    pub lost: u64,
}

impl ByteLedger {
    /// Whether nothing is unaccounted for.
    pub const fn is_exact(&self) -> bool {
        self.input == self.decoded + self.faulty + self.lost
    }
}

/// Ledger of events: `decoded = published + filtered + dropped`, at any time.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Pod,
    Zeroable,
    ZeroCopySend,
    serde::Serialize,
    serde::Deserialize,
)]
#[repr(C)]
pub struct EventLedger {
    /// Events decoded (those that wait for their packet count when it goes).
    pub decoded: u64,
    /// Events sent to the clients, those of this packet included.
    pub published: u64,
    /// Events the filters removed.
    pub filtered: u64,
    /// Events dropped because their pixel is not on the sensor.
    pub off_sensor: u64,
    /// Events dropped because the daemon was overloaded.
    pub overload: u64,
    /// Events dropped because shared memory was refused.
    pub no_memory: u64,
}

impl EventLedger {
    /// Events dropped, of all causes.
    pub const fn dropped(&self) -> u64 {
        self.off_sensor + self.overload + self.no_memory
    }

    /// Whether nothing is unaccounted for.
    pub const fn is_exact(&self) -> bool {
        self.decoded == self.published + self.filtered + self.dropped()
    }
}

/// Header of a packet of events.
///
/// ```
/// use lobula_client::PacketHeader;
/// assert_eq!(size_of::<PacketHeader>(), 256);
/// ```
#[derive(Clone, Copy, Debug, Pod, Zeroable, ZeroCopySend)]
#[type_name("LobulaPacketV1")]
#[repr(C)]
pub struct PacketHeader {
    /// [`ABI`].
    pub abi: u32,
    /// Properties, see [`Flags`].
    pub flags: u32,
    /// Number of the camera.
    pub camera: u32,
    /// Number of events.
    pub count: u32,
    /// The daemon's run, growing from run to run: ms since 1970 at its start.
    pub generation: u64,
    /// Number of the packet in its generation, from 0.
    pub sequence: u64,
    /// Anchor of the events' times, µs of sensor time: `full_time(t_first, event.t())`.
    pub t_first: u64,
    /// Stream time at the packet's end, inclusive, µs of sensor time.
    pub t_last: u64,
    /// Columns of the sensor.
    pub width: u16,
    /// Rows of the sensor.
    pub height: u16,
    /// Zero.
    pub reserved_geometry: u32,
    /// Host times.
    pub stamps: Stamps,
    /// Sensor time to host time.
    pub clock: ClockMap,
    /// Ledger of bytes at this packet's end.
    pub bytes: ByteLedger,
    /// Ledger of events at this packet's end.
    pub events: EventLedger,
    /// Events published in this generation before this packet. What a client has missed between two packets is the
    /// difference to what it was given.
    pub published_before: u64,
    /// Events that went out later than their packet's stretch of time, since the sensor's clock stepped back.
    pub late: u64,
    /// Zero.
    pub reserved: [u64; 6],
}

impl Default for PacketHeader {
    fn default() -> Self {
        Self { abi: ABI, ..Self::zeroed() }
    }
}

impl PacketHeader {
    /// The sensor's size.
    pub const fn geometry(&self) -> Geometry {
        Geometry::new(self.width, self.height)
    }

    /// Properties.
    pub const fn flags(&self) -> Flags {
        Flags(self.flags)
    }
}

/// The type of element of a code in a header.
const fn dtype_from_code(code: u32) -> Option<Dtype> {
    match code {
        1 => Some(Dtype::U8),
        2 => Some(Dtype::U16),
        3 => Some(Dtype::F16),
        4 => Some(Dtype::F32),
        _ => None,
    }
}

/// Header of a tensor: one window of a view.
#[derive(Clone, Copy, Debug, Pod, Zeroable, ZeroCopySend)]
#[type_name("LobulaTensorV1")]
#[repr(C)]
pub struct TensorHeader {
    /// [`ABI`].
    pub abi: u32,
    /// Properties, see [`Flags`].
    pub flags: u32,
    /// Number of the camera.
    pub camera: u32,
    /// Type of an element, see [`Dtype`].
    pub dtype: u32,
    /// The daemon's run, see [`PacketHeader::generation`].
    pub generation: u64,
    /// Number of the window among those published in its generation, from 0.
    pub sequence: u64,
    /// Extent, outermost first: channels, rows, columns. Row-major, no gaps.
    pub shape: [u32; 3],
    /// Zero.
    pub reserved_shape: u32,
    /// Start of the window, inclusive, µs of sensor time.
    pub t0: u64,
    /// End of the window, exclusive, µs of sensor time; the reference of decays and bins.
    pub t1: u64,
    /// Since when the view's memory of the stream has no gap, µs of sensor time. It may be younger than `t0`.
    pub state_since: u64,
    /// Events in the window.
    pub events: u64,
    /// Events so far that were older than their window, and were counted at its start.
    pub late: u64,
    /// Windows so far that were not published: no memory, no time, or a long silence.
    pub skipped: u64,
    /// Events published in this generation up to the window's end: where the window lies in the stream of events.
    pub published: u64,
    /// Host times of the packet that closed the window; `published_ns` of the tensor.
    pub stamps: Stamps,
    /// Sensor time to host time.
    pub clock: ClockMap,
    /// Columns of the sensor.
    pub width: u16,
    /// Rows of the sensor.
    pub height: u16,
    /// Zero.
    pub reserved_geometry: u32,
    /// Zero.
    pub reserved: [u64; 11],
}

impl Default for TensorHeader {
    fn default() -> Self {
        Self { abi: ABI, ..Self::zeroed() }
    }
}

impl TensorHeader {
    /// Type of an element; none if the header is broken.
    pub const fn dtype(&self) -> Option<Dtype> {
        dtype_from_code(self.dtype)
    }

    /// Properties.
    pub const fn flags(&self) -> Flags {
        Flags(self.flags)
    }

    /// Bytes of the tensor; 0 if the header is broken.
    pub fn bytes(&self) -> usize {
        let elements = self.shape.iter().try_fold(1usize, |n, extent| n.checked_mul(*extent as usize));
        match (elements, self.dtype()) {
            (Some(elements), Some(dtype)) => elements.checked_mul(dtype.bytes()).unwrap_or(0),
            _ => 0,
        }
    }
}

/// An event as it lies in shared memory. The same 8 bytes; its own type, since only the owner of a type can say that it
/// may be sent so, and the core knows nothing of shared memory.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(transparent)]
pub struct ShmEvent(pub Event);

/// 64 bytes on a 64-byte boundary: what a tensor is made of in shared memory, so that it is aligned for any kernel.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Line(pub [u8; 64]);

impl Line {
    /// How many lines hold `bytes` bytes.
    pub const fn needed(bytes: usize) -> usize {
        bytes.div_ceil(size_of::<Self>())
    }
}

// The name is part of the wire: a client with another layout must not connect.
#[allow(unsafe_code)] // iceoryx2 asks the owner of a type to vouch for it
mod sendable {
    use super::{Line, ShmEvent, ZeroCopySend};

    // SAFETY: plain data without pointers, `repr(transparent)` over the `repr(C)` Event, any bits valid (Pod).
    unsafe impl ZeroCopySend for ShmEvent {
        unsafe fn type_name() -> &'static str {
            "LobulaEventV1"
        }
    }

    // SAFETY: plain data without pointers, `repr(C)`, any bits valid (Pod).
    unsafe impl ZeroCopySend for Line {
        unsafe fn type_name() -> &'static str {
            "LobulaLineV1"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::mem::offset_of;

    #[test]
    fn types_of_element_have_fixed_codes() {
        for dtype in [Dtype::U8, Dtype::U16, Dtype::F16, Dtype::F32] {
            assert_eq!(dtype_from_code(dtype as u32), Some(dtype));
        }
        assert_eq!((dtype_from_code(0), dtype_from_code(5)), (None, None));
    }

    #[test]
    fn layouts_are_fixed() {
        assert_eq!((size_of::<PacketHeader>(), size_of::<TensorHeader>()), (256, 256));
        assert_eq!(offset_of!(PacketHeader, generation), 16);
        assert_eq!(offset_of!(PacketHeader, t_first), 32);
        assert_eq!(offset_of!(PacketHeader, stamps), 56);
        assert_eq!(offset_of!(PacketHeader, clock), 88);
        assert_eq!(offset_of!(PacketHeader, bytes), 112);
        assert_eq!(offset_of!(PacketHeader, events), 144);
        assert_eq!(offset_of!(PacketHeader, published_before), 192);
        assert_eq!(offset_of!(TensorHeader, shape), 32);
        assert_eq!(offset_of!(TensorHeader, t0), 48);
        assert_eq!((size_of::<Line>(), align_of::<Line>(), size_of::<ShmEvent>()), (64, 64, 8));
    }
}
