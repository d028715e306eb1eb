//! Bytes to events, a transfer at a time into one buffer: every encoding, every kernel of this machine.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lobula_benches::input::{PACKET_EVENTS, Scene, packets};
use lobula_core::wire::{AnyDecoder, AnyEncoder, Encoding, evt3};
use lobula_core::{Decode, Encode, Event, Sink};

/// Events of one pass: enough to leave the caches.
const EVENTS: usize = 1_000_000;
/// Bytes handed to the decoder in one go.
const TRANSFER_BYTES: usize = 1 << 16;

fn decode(c: &mut Criterion) {
    let scene = Scene::load(EVENTS).expect("a scene");
    let mut group = c.benchmark_group("decode");
    group.throughput(Throughput::Elements(scene.events.len() as u64)).sample_size(20);
    for kernel in evt3::Kernel::available() {
        let name = format!("evt3_{kernel:?}").to_lowercase();
        group.bench_function(name, |b| {
            b.iter(|| events_of(&mut evt3::Decoder::with_kernel(scene.geometry, kernel), &scene.bytes))
        });
    }
    for encoding in Encoding::ALL {
        let bytes = encode(&scene, *encoding);
        let decoder = || AnyDecoder::new(*encoding, scene.geometry);
        group.bench_function(encoding.name(), |b| b.iter(|| events_of(&mut decoder(), &bytes)));
    }
    group.finish();
}

fn events_of(decoder: &mut impl Decode, bytes: &[u8]) -> usize {
    let mut buffer = [Event::default(); PACKET_EVENTS];
    let mut events = 0;
    for mut transfer in bytes.chunks(TRANSFER_BYTES) {
        while !transfer.is_empty() {
            let mut sink = Sink::new(&mut buffer);
            let taken = decoder.decode(transfer, &mut sink);
            events += sink.len();
            black_box(sink.block(decoder.geometry()));
            transfer = &transfer[taken..];
        }
    }
    events
}

fn encode(scene: &Scene, encoding: Encoding) -> Vec<u8> {
    let mut encoder = AnyEncoder::new(encoding);
    let mut buffer = vec![0; 1 << 16];
    let mut bytes = Vec::new();
    for mut packet in packets(scene.span(scene.events.len())) {
        while !packet.events.is_empty() {
            let done = encoder.encode(packet, &mut buffer);
            assert_eq!(done.refused, None);
            bytes.extend_from_slice(&buffer[..done.bytes]);
            packet = packet.with_events(&packet.events[done.events..]);
        }
    }
    loop {
        let last = encoder.finish(&mut buffer);
        if last == 0 {
            return bytes;
        }
        bytes.extend_from_slice(&buffer[..last]);
    }
}

criterion_group!(benches, decode);
criterion_main!(benches);
