use super::*;
use crate::OpenOptions;

const SENSOR: Geometry = Geometry::new(346, 260);

/// Pseudo-random numbers.
struct Draw(u64);

impl Draw {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % end
    }
}

/// Events of one second on the sensor, with every kind of nanoseconds and polarity.
fn alike(len: usize, draw: &mut Draw) -> Vec<Raw> {
    let raw = |i: usize| {
        let ns = match i % 7 {
            0 => [0, 999, 1000, 999_999_999, u32::MAX][draw.below(5) as usize],
            _ => draw.below(1_000_000_000) as u32,
        };
        let (x, y) = (draw.below(346) as u16, draw.below(260) as u16);
        Raw { x, y, s: 1_700_000_000, ns, p: [0, 1, 1, 0, 128, 255][draw.below(6) as usize] }
    };
    (0..len).map(raw).collect()
}

/// As it stands in a message, padded as `Raw::of` has it.
fn bytes<const STRIDE: usize, const PAD: usize>(raw: &Raw) -> [u8; STRIDE] {
    let mut bytes = [0xA5; STRIDE];
    let x = PAD.min(1);
    bytes[x..x + 2].copy_from_slice(&raw.x.to_le_bytes());
    bytes[x + 2..x + 4].copy_from_slice(&raw.y.to_le_bytes());
    bytes[PAD + 4..PAD + 8].copy_from_slice(&raw.s.to_le_bytes());
    bytes[PAD + 8..PAD + 12].copy_from_slice(&raw.ns.to_le_bytes());
    bytes[PAD + 12] = raw.p;
    bytes
}

fn kernel_and_twin<const STRIDE: usize, const PAD: usize>() {
    let Some(cpu) = Cpu::detect() else { return };
    let draw = &mut Draw(1);
    let near = Near { s: 1_700_000_000, shift_us: -77, geometry: SENSOR };
    let same = Alike::new(near.s, &near).unwrap();
    for len in (0..40).chain([256, 1000]) {
        for fault in 0..6 {
            let mut raws = alike(len, draw);
            if let Some(raw) = raws.len().checked_sub(1).map(|last| draw.below(last as u64 + 1) as usize) {
                let raw = &mut raws[raw];
                match fault {
                    0 => raw.s ^= 1 << draw.below(32),
                    1 => raw.x = 346 + draw.below(60_000) as u16,
                    2 => raw.y = 260 + draw.below(60_000) as u16,
                    3 => raw.y |= 0x8000,
                    _ => {}
                }
            }
            let events: Vec<_> = raws.iter().map(bytes::<STRIDE, PAD>).collect();
            let mut expected = vec![Event::default(); len];
            let is_alike = same.portable::<STRIDE, PAD>(&events, &mut expected);
            assert_eq!(is_alike, fault > 3 || len == 0);
            let mut found = vec![Event::default(); len];
            let (done, good) = cpu.events::<STRIDE, PAD>(&same, &events, &mut found);
            assert!(done + 8 > len && done <= len, "{done} of {len}");
            let bad = |raw: &Raw| raw.s != near.s || !SENSOR.contains(raw.x, raw.y);
            assert_eq!(good, !raws[..done].iter().any(bad), "{len} {fault}");
            if good {
                assert_eq!(found[..done], expected[..done], "{len} {fault}");
            }
            assert_eq!(same.events::<STRIDE, PAD>(&events, &mut found, Some(cpu)), is_alike);
        }
    }
}

#[test]
fn kernel_and_twin_agree() {
    kernel_and_twin::<EVENT_BYTES, 0>();
    kernel_and_twin::<PADDED_BYTES, 3>();
}

/// What a message of these events gives when it comes in pieces of `piece` bytes, and how many are off the sensor.
fn decoded(raws: &[Raw], wire: Wire, cpu: Option<Cpu>, piece: usize) -> (Vec<(u64, Event)>, u64) {
    let mut message: Vec<u8> = Vec::new();
    for (i, raw) in raws.iter().enumerate() {
        match wire == Wire::Cdr && i > 0 {
            false => message.extend(bytes::<EVENT_BYTES, 0>(raw)),
            true => message.extend(bytes::<PADDED_BYTES, 3>(raw)),
        }
    }
    let intake = Intake::new(SENSOR, &OpenOptions::default());
    let mut arrays = EventArrays { cpu, ..EventArrays::new(intake, 0, wire) };
    assert!(
        arrays.begin(Head { size: [346, 260], events: raws.len() as u32, bytes: 0 }, message.len() as u64)
    );
    let (mut at, mut end, mut told) = (0, piece.min(message.len()), Vec::new());
    while at < message.len() {
        let mut memory = [Event::default(); 300];
        let mut sink = Sink::new(&mut memory);
        let step = arrays.decode(&message[at..end], &mut sink).unwrap();
        at += step.taken;
        if !step.full {
            end = (end + piece).min(message.len());
        }
        let block = sink.block(SENSOR);
        let span = block.span();
        told.extend(span.events.iter().map(|event| (span.time(*event), *event)));
    }
    (told, arrays.intake.counters.off_sensor)
}

/// Against a loop over the events: seconds that change, also by years, events off the sensor, in every place.
#[test]
fn messages_give_what_stands_in_them() {
    let draw = &mut Draw(2);
    for round in 0..300 {
        let mut raws = alike(draw.below(700) as usize + 1, draw);
        for _ in 0..draw.below(4) {
            let at = draw.below(raws.len() as u64) as usize;
            match draw.below(4) {
                0 => raws[at..].iter_mut().for_each(|raw| raw.s += 1),
                1 => raws[at].s -= 100_000_000,
                2 => raws[at].x = 346,
                _ => raws[at].y = 0x8000 + 3,
            }
        }
        let on_sensor = |raw: &&Raw| raw.x < 346 && raw.y < 260;
        let expected: Vec<_> = raws
            .iter()
            .filter(on_sensor)
            .map(|raw| {
                let t = u64::from(raw.s) * 1_000_000 + u64::from(raw.ns) / 1000;
                (t, Event::new(t as u32, raw.x, raw.y, Polarity::from_bit(u16::from(raw.p != 0))))
            })
            .collect();
        let off = (raws.len() - expected.len()) as u64;
        for (wire, cpu) in
            [Wire::Ros1, Wire::Cdr].into_iter().flat_map(|wire| [(wire, None), (wire, Cpu::detect())])
        {
            for piece in [5000, 1 + draw.below(2000) as usize, usize::MAX / 2] {
                let (told, off_sensor) = decoded(&raws, wire, cpu, piece);
                assert!(told == expected, "{round} {wire:?} {piece}");
                assert_eq!(off_sensor, off);
            }
        }
    }
}
