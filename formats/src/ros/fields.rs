//! Fields of a serialised message, in the order of its definition, checked against the bytes that are there.
//!
//! ```text
//! ROS 1   little-endian, packed; a string is u32 length, bytes
//! CDR     4 bytes: 0, byte order (1 = little), 0, 0; then fields aligned to their size, counted from there;
//!         a string is u32 length with its closing 0, bytes, 0
//! header  ROS 1: u32 seq, u32 s, u32 ns, string frame    ROS 2: i32 s, u32 ns, string frame
//! ```

/// How messages are serialised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wire {
    Ros1,
    Cdr,
}

/// Bytes before the fields of CDR.
pub(crate) const CDR_HEAD: [u8; 4] = [0, 1, 0, 0];

/// Most bytes that may follow the last field: CDR is padded by some.
pub(crate) const CDR_TAIL_BYTES_MAX: u64 = 7;

/// A reader of fields; `None` is the end of the bytes or something no message holds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fields<'a> {
    bytes: &'a [u8],
    at: usize,
    wire: Wire,
}

/// A message's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stamp {
    pub s: i64,
    pub ns: u32,
}

impl Stamp {
    /// In whole µs, rounded down.
    pub fn us(self) -> i64 {
        self.s * 1_000_000 + i64::from(self.ns / 1000)
    }
}

impl<'a> Fields<'a> {
    /// The fields of a message. Big-endian CDR is not read: no robot writes it.
    pub fn new(message: &'a [u8], wire: Wire) -> Option<Self> {
        match wire {
            Wire::Ros1 => Some(Self { bytes: message, at: 0, wire }),
            Wire::Cdr => {
                let (head, bytes) = message.split_at_checked(CDR_HEAD.len())?;
                (head.get(..2)? == CDR_HEAD.get(..2)?).then_some(Self { bytes, at: 0, wire })
            }
        }
    }

    /// Offset of the next byte in the message.
    pub fn offset(&self) -> usize {
        match self.wire {
            Wire::Ros1 => self.at,
            Wire::Cdr => CDR_HEAD.len() + self.at,
        }
    }

    /// The next `len` bytes.
    pub fn bytes(&mut self, len: usize) -> Option<&'a [u8]> {
        let bytes = self.bytes.get(self.at..)?.get(..len)?;
        self.at += len;
        Some(bytes)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        if self.wire == Wire::Cdr {
            self.at = self.at.next_multiple_of(N);
        }
        self.bytes(N)?.try_into().ok()
    }

    pub fn u8(&mut self) -> Option<u8> {
        self.number().map(u8::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    pub fn f64(&mut self) -> Option<f64> {
        self.number().map(f64::from_le_bytes)
    }

    pub fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut all = [0.0; N];
        for one in &mut all {
            *one = self.f64()?;
        }
        Some(all)
    }

    /// A string, without its closing 0.
    pub fn string(&mut self) -> Option<&'a [u8]> {
        let len = self.u32()? as usize;
        let text = self.bytes(len)?;
        match self.wire {
            Wire::Ros1 => Some(text),
            Wire::Cdr => Some(text.strip_suffix(&[0]).unwrap_or(text)),
        }
    }

    pub fn stamp(&mut self) -> Option<Stamp> {
        let s = self.u32()?;
        let ns = self.u32()?;
        let s = match self.wire {
            Wire::Ros1 => i64::from(s),
            Wire::Cdr => i64::from(s as i32),
        };
        Some(Stamp { s, ns })
    }

    /// `std_msgs/Header`: its time.
    pub fn header(&mut self) -> Option<Stamp> {
        if self.wire == Wire::Ros1 {
            self.u32()?;
        }
        let stamp = self.stamp()?;
        self.string()?;
        Some(stamp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cdr_aligns_and_ros_1_packs() {
        let cdr = [0, 1, 0, 0, 7, 0, 0, 0, 2, 0, 0, 0, b'a', 0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0];
        let mut fields = Fields::new(&cdr, Wire::Cdr).unwrap();
        assert_eq!(fields.u8(), Some(7));
        assert_eq!(fields.string(), Some(&b"a"[..]));
        assert_eq!((fields.u64(), fields.offset(), fields.u8()), (Some(5), 28, None));
        let ros1 = [7, 1, 0, 0, 0, b'a', 5, 0, 0, 0, 0, 0, 0, 0];
        let mut fields = Fields::new(&ros1, Wire::Ros1).unwrap();
        assert_eq!((fields.u8(), fields.string(), fields.u64()), (Some(7), Some(&b"a"[..]), Some(5)));
        assert!(Fields::new(&[0, 0, 0, 0], Wire::Cdr).is_none(), "big-endian");
    }

    #[test]
    fn lengths_beyond_the_bytes_are_refused() {
        let ros1 = [255, 255, 255, 255, 1];
        assert_eq!(Fields::new(&ros1, Wire::Ros1).unwrap().string(), None);
        assert_eq!(Fields::new(&ros1, Wire::Ros1).unwrap().bytes(6), None);
    }

    #[test]
    fn times_round_down_to_whole_microseconds() {
        assert_eq!(Stamp { s: 1, ns: 999_999_999 }.us(), 1_999_999);
        assert_eq!(Stamp { s: -1, ns: 1_000 }.us(), -999_999);
    }
}
