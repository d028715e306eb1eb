//! Decodes a recording with a kernel of choice, `lobula-decode ENCODING KERNEL WIDTH HEIGHT PASSES FILE`, and prints how
//! many events a pass has: for `tests/it/neon.rs`, which counts what it executes.

use lobula_core::wire::{AnyDecoder, Encoding, Kernel, evt2, evt3, evt21};
use lobula_core::{Decode, Event, Geometry, Sink};

/// Events of a packet.
const PACKET_EVENTS: usize = 4096;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [encoding, kernel, width, height, passes, file] = &arguments[..] else {
        panic!("ENCODING KERNEL WIDTH HEIGHT PASSES FILE");
    };
    let number = |text: &str| text.parse::<u16>().expect("a number");
    let encoding = Encoding::from_name(encoding).expect("an encoding");
    let kernel = Kernel::available().find(|of| format!("{of:?}") == *kernel).expect("a kernel of this CPU");
    let geometry = Geometry::new(number(width), number(height));
    let bytes = std::fs::read(file).expect("a recording");
    let mut memory = vec![Event::default(); PACKET_EVENTS];
    let mut events = 0;
    for _ in 0..number(passes) {
        events = pass(decoder(encoding, geometry, kernel), &bytes, &mut memory);
    }
    println!("{events}");
}

fn decoder(encoding: Encoding, geometry: Geometry, kernel: Kernel) -> AnyDecoder {
    match encoding {
        Encoding::Evt2 => AnyDecoder::Evt2(evt2::Decoder::with_kernel(geometry, kernel)),
        Encoding::Evt21(order) => AnyDecoder::Evt21(evt21::Decoder::with_kernel(geometry, order, kernel)),
        Encoding::Evt3 => AnyDecoder::Evt3(evt3::Decoder::with_kernel(geometry, kernel)),
        Encoding::Evt4 => AnyDecoder::new(encoding, geometry),
    }
}

fn pass(mut decoder: AnyDecoder, bytes: &[u8], memory: &mut [Event]) -> usize {
    let (mut rest, mut events) = (bytes, 0);
    while !rest.is_empty() {
        let mut sink = Sink::new(memory);
        let taken = decoder.decode(rest, &mut sink);
        rest = &rest[taken..];
        events += sink.len();
    }
    events
}
