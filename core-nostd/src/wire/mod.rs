//! The byte formats that cameras send: each a decoder and an encoder in a file of its own, and one list of them all.
//!
//! Firmware takes the types of its camera's format; who learns the format at run time builds an [`AnyDecoder`] or
//! [`AnyEncoder`] from an [`Encoding`].

#[cfg(target_arch = "x86_64")]
mod avx512;
mod carry;
pub mod evt2;
pub mod evt21;
pub mod evt3;
pub mod evt4;
mod kernel;
mod mask;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
mod neon;
mod steady;

#[cfg(test)]
mod oracle;
#[cfg(test)]
mod testing;
mod time_high;

use crate::{Counters, Decode, Encode, Encoded, Geometry, Sink, Span, Trigger};
pub use evt21::WordOrder;
pub use kernel::Kernel;

/// The registry: a line per format, `variant (its parameters) = module, { name: value }`. Calls `$with!` with it.
#[doc(hidden)]
#[macro_export]
macro_rules! for_each_encoding {
    ($with:path) => {
        $with! {
            /// Prophesee EVT 2.0: 32-bit words, one event each.
            Evt2 = evt2, { "evt2": Evt2 }
            /// Prophesee EVT 2.1: 64-bit words, up to 32 events each.
            Evt21(order: WordOrder) = evt21, {
                "evt21": Evt21(WordOrder::Little),
                "evt21_legacy": Evt21(WordOrder::Legacy)
            }
            /// Prophesee EVT 3.0: 16-bit words with state, 1.3 to 3 bytes an event.
            Evt3 = evt3, { "evt3": Evt3 }
            /// Prophesee EVT 4.0: 32-bit words, one event each, or two words for up to 32 events.
            Evt4 = evt4, { "evt4": Evt4 }
        }
    };
}

macro_rules! encodings {
    ($(
        $(#[$doc:meta])*
        $variant:ident $(($parameter:ident: $type:ty))? = $module:ident, { $($name:literal: $of:ident $(($value:path))?),+ }
    )+) => {
        /// A byte format.
        ///
        /// ```
        /// use lobula_core::wire::{Encoding, WordOrder};
        /// let legacy = Encoding::Evt21(WordOrder::Legacy);
        /// assert_eq!(legacy.name(), "evt21_legacy");
        /// assert_eq!(Encoding::from_name("evt21_legacy"), Some(legacy));
        /// ```
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Encoding {
            $($(#[$doc])* $variant $(($type))?,)+
        }

        impl Encoding {
            /// Every format, in each of its flavours.
            pub const ALL: &[Self] = &[$($(Self::$of $(($value))?,)+)+];

            /// The name in configurations and reports.
            pub fn name(self) -> &'static str {
                $($(if self == Self::$of $(($value))? {
                    return $name;
                })+)+
                ""
            }
        }

        /// A decoder of any format.
        #[derive(Clone, Debug)]
        pub enum AnyDecoder {
            $($(#[$doc])* $variant($module::Decoder),)+
        }

        impl AnyDecoder {
            /// A decoder of this format for a sensor of this size.
            pub fn new(encoding: Encoding, geometry: Geometry) -> Self {
                match encoding {
                    $(Encoding::$variant $(($parameter))? =>
                        Self::$variant($module::Decoder::new(geometry $(, $parameter)?)),)+
                }
            }
        }

        impl Decode for AnyDecoder {
            fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> usize {
                match self { $(Self::$variant(decoder) => decoder.decode(bytes, sink),)+ }
            }

            fn finish(&mut self) {
                match self { $(Self::$variant(decoder) => decoder.finish(),)+ }
            }

            fn gap(&mut self, near: Option<u64>) {
                match self { $(Self::$variant(decoder) => decoder.gap(near),)+ }
            }

            fn now(&self) -> u64 {
                match self { $(Self::$variant(decoder) => decoder.now(),)+ }
            }

            fn geometry(&self) -> Geometry {
                match self { $(Self::$variant(decoder) => decoder.geometry(),)+ }
            }

            fn pending(&self) -> usize {
                match self { $(Self::$variant(decoder) => decoder.pending(),)+ }
            }

            fn counters(&self) -> &Counters {
                match self { $(Self::$variant(decoder) => decoder.counters(),)+ }
            }
        }

        /// An encoder of any format.
        #[derive(Clone, Debug)]
        pub enum AnyEncoder {
            $($(#[$doc])* $variant($module::Encoder),)+
        }

        impl AnyEncoder {
            /// An encoder of this format at the start of a stream.
            pub fn new(encoding: Encoding) -> Self {
                match encoding {
                    $(Encoding::$variant $(($parameter))? =>
                        Self::$variant($module::Encoder::new($($parameter)?)),)+
                }
            }
        }

        impl Encode for AnyEncoder {
            fn encode(&mut self, span: Span<'_>, out: &mut [u8]) -> Encoded {
                match self { $(Self::$variant(encoder) => encoder.encode(span, out),)+ }
            }

            fn trigger(&mut self, trigger: Trigger, out: &mut [u8]) -> Encoded {
                match self { $(Self::$variant(encoder) => encoder.trigger(trigger, out),)+ }
            }

            fn finish(&mut self, out: &mut [u8]) -> usize {
                match self { $(Self::$variant(encoder) => encoder.finish(out),)+ }
            }
        }
    };
}

for_each_encoding!(encodings);

impl Encoding {
    /// How many of these bytes, which start anywhere between two words of a stream, a fresh decoder must take to know
    /// all that it needs: from there on it gives what a decoder gives that read all before, but for whole wraps of
    /// time. `None` where the bytes do not tell. So a recording can be decoded from several places at once.
    pub fn settled(self, bytes: &[u8]) -> Option<usize> {
        match self {
            Self::Evt2 => evt2::settled(bytes),
            Self::Evt21(order) => evt21::settled(bytes, order),
            Self::Evt3 => evt3::settled(bytes),
            Self::Evt4 => None,
        }
    }

    /// After how many µs the format's own time wraps.
    pub const fn wrap_us(self) -> u64 {
        match self {
            Self::Evt2 | Self::Evt21(_) | Self::Evt4 => time_high::WRAP_US,
            Self::Evt3 => evt3::WRAP_US,
        }
    }

    /// Bytes of a word.
    pub const fn word_bytes(self) -> usize {
        match self {
            Self::Evt2 | Self::Evt4 => 4,
            Self::Evt21(_) => 8,
            Self::Evt3 => 2,
        }
    }

    /// The format of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|encoding| encoding.name() == name)
    }
}

impl core::fmt::Display for Encoding {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name())
    }
}
