//! The CRC-32 of Ethernet, zip and PNG (ISO-HDLC): polynomial 0x04C11DB7, reflected, all bits inverted.

/// The polynomial, reflected.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// What each byte does to an empty register.
static TABLE: [u32; 256] = table();

const fn table() -> [u32; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut register = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            register = if register & 1 == 1 { register >> 1 ^ POLYNOMIAL } else { register >> 1 };
            bit += 1;
        }
        table[byte] = register;
        byte += 1;
    }
    table
}

/// A CRC-32 of the bytes given so far.
///
/// ```
/// use lobula_core::link::Crc32;
/// assert_eq!(Crc32::of(b"123456789"), 0xCBF4_3926); // the check value of the catalogue of CRCs
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crc32(u32);

impl Crc32 {
    /// Of no bytes.
    pub const fn new() -> Self {
        Self(!0)
    }

    /// Takes another byte.
    #[inline]
    pub fn push(&mut self, byte: u8) {
        let [low, ..] = self.0.to_le_bytes();
        let known = TABLE.get(usize::from(low ^ byte)).copied().unwrap_or_default();
        self.0 = self.0 >> 8 ^ known;
    }

    /// Takes more bytes.
    pub fn extend(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.push(*byte));
    }

    /// The checksum.
    pub const fn value(self) -> u32 {
        !self.0
    }

    /// That of these bytes.
    pub fn of(bytes: &[u8]) -> u32 {
        let mut crc = Self::new();
        crc.extend(bytes);
        crc.value()
    }
}

impl Default for Crc32 {
    fn default() -> Self {
        Self::new()
    }
}
