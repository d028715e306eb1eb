//! Bytes to packets: decode, filter, stage, hand out. No port, no thread: those who own them call this.
//!
//! Both ledgers are exact in every header: what was counted where is stated at [`Pipeline::bytes`] and
//! [`Pipeline::events`]. Nothing here waits, allocates or locks.

use crate::clock;
use crate::source::Restart;
use lobula_client::{ByteLedger, EventLedger, Flags, PACKET_EVENTS_MAX, PacketHeader, Stamps};
use lobula_core::chain::Chain;
use lobula_core::wire::{AnyDecoder, Encoding};
use lobula_core::{Block, Counters, Decode, Event, Geometry, Sink, Transform, full_time};

/// Events decoded and filtered in one go: they stay in the first-level cache.
const BLOCK_EVENTS: usize = 4096;

/// A step back in stream time by more than this is a restart of the camera's clock.
const CLOCK_STEP_US: u64 = 1 << 29;

/// Takes complete packets: loans memory, writes, sends, wakes.
pub trait Outlet {
    /// Sends a packet; it stamps `published_ns` itself. False: there was no memory for it, and it is not sent.
    fn packet(&mut self, header: PacketHeader, events: &[Event]) -> bool;
}

/// Bytes of one transfer of the source.
#[derive(Clone, Copy, Debug, Default)]
pub struct Arrival<'a> {
    /// The bytes.
    pub bytes: &'a [u8],
    /// When they were due (0: not paced), and when the last of them arrived.
    pub due_ns: u64,
    /// When the last of them arrived.
    pub arrived_ns: u64,
    /// Bytes that were lost right before them.
    pub lost: u64,
    /// They start a recording over.
    pub restart: Option<Restart>,
}

/// What is the same in every packet of a run.
#[derive(Clone, Copy, Debug)]
pub struct Identity {
    /// Number of the camera.
    pub camera: u32,
    /// The daemon's run.
    pub generation: u64,
    /// Flags of every packet.
    pub flags: Flags,
    /// Longest stretch of stream time of a packet, in µs.
    pub packet_us: u32,
}

/// From a camera's bytes to packets.
pub struct Pipeline {
    identity: Identity,
    decoder: AnyDecoder,
    chain: Chain,
    staging: Staging,
    /// Added to sensor time, in µs, where a recording is looped.
    shift_us: u64,
    stamps: Stamps,
    /// Flags of the next packet alone.
    flags_once: Flags,
    bytes_given: u64,
    bytes_lost: u64,
    published: u64,
    no_memory: u64,
    /// Events staged or handed out so far.
    staged: u64,
    late: u64,
    sequence: u64,
}

impl Pipeline {
    /// A pipeline for a camera whose events are encoded so, through a chain for a sensor of the same size.
    pub fn new(encoding: Encoding, chain: Chain, identity: Identity) -> Self {
        Self {
            identity,
            decoder: AnyDecoder::new(encoding, chain.geometry()),
            chain,
            staging: Staging::new(identity.packet_us),
            shift_us: 0,
            stamps: Stamps::default(),
            flags_once: Flags::default(),
            bytes_given: 0,
            bytes_lost: 0,
            published: 0,
            no_memory: 0,
            staged: 0,
            late: 0,
            sequence: 0,
        }
    }

    /// The size of the sensor that packets are of: after the chain.
    pub fn geometry(&self) -> Geometry {
        self.chain.output_geometry()
    }

    /// Decodes and filters what arrived, and hands out the packets that are full. What is left waits for
    /// [`flush`](Self::flush).
    pub fn feed(&mut self, arrival: Arrival<'_>, outlet: &mut impl Outlet) {
        self.note_breaks(&arrival, outlet);
        self.stamps.due_ns = arrival.due_ns;
        self.stamps.arrived_ns = arrival.arrived_ns;
        let mut rest = arrival.bytes;
        while !rest.is_empty() {
            let taken = self.decode(rest, outlet);
            rest = rest.get(taken..).unwrap_or_default();
        }
    }

    /// Decodes, filters and stages one block, right behind the events of the open packet; returns the bytes taken.
    fn decode(&mut self, bytes: &[u8], outlet: &mut impl Outlet) -> usize {
        let mut sink = Sink::new(self.staging.spare());
        let taken = self.decoder.decode(bytes, &mut sink);
        self.bytes_given += taken as u64;
        if sink.is_empty() {
            return taken; // no event, no time
        }
        let mut block = sink.block(self.chain.geometry());
        shift(&mut block, self.shift_us);
        let fits = self.chain.apply(&mut block);
        debug_assert!(fits.is_ok(), "decoder and chain were made for one sensor");
        self.stamps.decoded_ns = clock::now_ns();
        let found = Found { t_first: block.t_first, t_last: block.t_last, len: block.len() };
        self.stage(found, outlet);
        taken
    }

    /// Adds a block's events to the open packet, and hands it out each time it is full.
    fn stage(&mut self, found: Found, outlet: &mut impl Outlet) {
        let step = found.t_first.saturating_add(CLOCK_STEP_US) < self.staging.t_last;
        self.staging.found = found;
        if step {
            self.flush(outlet);
            self.flags_once |= Flags::CLOCK_STEP;
        }
        while self.staging.found.len > 0 {
            let (taken, late) = self.staging.take();
            self.staged += taken as u64;
            self.late += late as u64;
            if self.staging.found.len > 0 {
                self.flush(outlet);
            }
        }
    }

    /// Hands out what is staged, if anything. To be called where the source pauses.
    pub fn flush(&mut self, outlet: &mut impl Outlet) {
        if self.staging.len > 0 {
            self.send(Flags::default(), outlet);
        }
    }

    /// Hands out an empty packet, so that clients see stream time go on: to be called after a packet's time without one.
    pub fn heartbeat(&mut self, outlet: &mut impl Outlet) {
        self.flush(outlet);
        self.send(Flags::default(), outlet);
    }

    /// The source has ended: hands out what is left, and an empty packet that says so.
    pub fn finish(&mut self, outlet: &mut impl Outlet) {
        self.decoder.finish();
        self.flush(outlet);
        self.send(Flags::END, outlet);
    }

    fn send(&mut self, flags: Flags, outlet: &mut impl Outlet) {
        let count = self.staging.len as u64;
        let now = self.now();
        let (t_first, t_last) =
            if count > 0 { (self.staging.t_first, self.staging.t_last) } else { (now, now) };
        let published_before = self.published;
        self.published += count;
        self.staging.len = 0;
        let geometry = self.geometry();
        let header = PacketHeader {
            flags: (self.identity.flags | self.flags_once | flags).0,
            camera: self.identity.camera,
            count: count as u32,
            generation: self.identity.generation,
            sequence: self.sequence,
            t_first,
            t_last,
            width: geometry.width,
            height: geometry.height,
            stamps: self.stamps,
            bytes: self.bytes(),
            events: self.events(),
            published_before,
            late: self.late,
            ..PacketHeader::default()
        };
        let sent = outlet.packet(header, self.staging.events.get(..count as usize).unwrap_or_default());
        self.staging.close(count as usize);
        if sent {
            self.sequence += 1;
            self.flags_once = Flags::default();
        } else {
            self.published -= count;
            self.no_memory += count;
            self.flags_once |= Flags::GAP;
        }
    }

    /// Tells the decoder where bytes are missing.
    fn note_breaks(&mut self, arrival: &Arrival<'_>, outlet: &mut impl Outlet) {
        if arrival.lost > 0 {
            self.bytes_given += arrival.lost;
            self.bytes_lost += arrival.lost;
            self.decoder.gap(Some(self.decoder.now()));
            self.flags_once |= Flags::GAP | Flags::OVERLOAD;
        }
        if let Some(restart) = arrival.restart {
            self.flush(outlet);
            self.decoder.gap(Some(restart.near_us));
            self.shift_us = restart.shift_us;
        }
    }

    /// Stream time in µs.
    pub fn now(&self) -> u64 {
        self.decoder.now() + self.shift_us
    }

    /// Ledger of bytes. Bytes of a word that is not complete yet are not in it.
    pub fn bytes(&self) -> ByteLedger {
        let counters = self.decoder.counters();
        ByteLedger {
            input: self.bytes_given - self.decoder.pending() as u64,
            decoded: counters.bytes_decoded,
            faulty: counters.bytes_faulty,
            lost: self.bytes_lost,
        }
    }

    /// Ledger of events. Those that are staged, or still in the block being staged, are not in it.
    pub fn events(&self) -> EventLedger {
        let counters = self.decoder.counters();
        let filtered = self.chain.removed();
        let waiting =
            counters.events - counters.off_sensor - filtered - self.staged + self.staging.len as u64;
        EventLedger {
            decoded: counters.events - waiting,
            published: self.published,
            filtered,
            off_sensor: counters.off_sensor,
            overload: 0,
            no_memory: self.no_memory,
        }
    }

    /// The decoder's counts.
    pub fn counters(&self) -> &Counters {
        self.decoder.counters()
    }

    /// Packets handed out.
    pub fn packets(&self) -> u64 {
        self.sequence
    }
}

/// Moves a block's time on by `us`.
fn shift(block: &mut Block<'_>, us: u64) {
    if us == 0 {
        return;
    }
    block.t_first = block.t_first.wrapping_add(us);
    block.t_last = block.t_last.wrapping_add(us);
    for event in block.events_mut() {
        *event = Event::new(event.t().wrapping_add(us as u32), event.x(), event.y(), event.polarity());
    }
}

/// The open packet, and behind it the block that was decoded last: its events are where they belong already, unless the
/// packet ends within it. A packet ends on a grid of stream time, so that packets do not depend on how bytes came.
struct Staging {
    /// `[..len]`: the packet; `[len..len + found.len]`: the block.
    events: Box<[Event]>,
    len: usize,
    found: Found,
    packet_us: u32,
    t_first: u64,
    t_last: u64,
    /// Where its stretch of time ends, exclusive.
    t_end: u64,
}

/// Events of a block that are not in a packet yet.
#[derive(Clone, Copy, Debug, Default)]
struct Found {
    /// As those of [`Block`].
    t_first: u64,
    t_last: u64,
    /// How many.
    len: usize,
}

impl Staging {
    fn new(packet_us: u32) -> Self {
        let events = vec![Event::default(); PACKET_EVENTS_MAX + BLOCK_EVENTS].into();
        let (len, found) = (0, Found::default());
        Self { events, len, found, packet_us: packet_us.max(1), t_first: 0, t_last: 0, t_end: 0 }
    }

    /// Memory for the next block, once the one before is in packets.
    fn spare(&mut self) -> &mut [Event] {
        self.events.get_mut(self.len..self.len + BLOCK_EVENTS).unwrap_or_default()
    }

    /// Takes the events of the block, from the first on, that belong to the open packet and fit: how many, and how many
    /// of them are older than its stretch of time. None: it is full, or they are of a later one.
    fn take(&mut self) -> (usize, usize) {
        let Found { t_first, t_last, len } = self.found;
        let Some(&first) = self.events.get(self.len) else { return (0, 0) };
        if self.len == 0 {
            self.open(full_time(t_first, first.t()));
        }
        let fit = len.min(PACKET_EVENTS_MAX - self.len);
        let fit = self.events.get(self.len..self.len + fit).unwrap_or_default();
        // Where the block as a whole ends before the packet does, a step back of a few µs across that is not looked for.
        let later = |event: &Event| full_time(t_first, event.t()) >= self.t_end;
        let own = match (t_last >= self.t_end).then(|| fit.iter().position(later)).flatten() {
            Some(n) => fit.get(..n).unwrap_or_default(),
            None => fit,
        };
        let late = count_before(own, t_first, self.t_end.saturating_sub(u64::from(self.packet_us)));
        if let Some(last) = own.last() {
            self.t_last = self.t_last.max(full_time(t_first, last.t()));
        }
        let taken = own.len();
        self.len += taken;
        self.found.len -= taken;
        (taken, late)
    }

    fn open(&mut self, t: u64) {
        let packet_us = u64::from(self.packet_us);
        self.t_first = t;
        self.t_last = t;
        self.t_end = (t - t % packet_us).saturating_add(packet_us);
    }

    /// The packet, of `len` events, has gone: what is left of the block moves to its place.
    fn close(&mut self, len: usize) {
        self.len = 0;
        if len > 0 && self.found.len > 0 {
            self.events.copy_within(len..len + self.found.len, 0);
        }
    }
}

/// How many of the events, whose times are near `anchor`, are of before `t`. In 32 bits, several at a time: this is done
/// to every event.
fn count_before(events: &[Event], anchor: u64, t: u64) -> usize {
    let Ok(reach) = i32::try_from(i128::from(t) - i128::from(anchor)) else {
        return if t < anchor { 0 } else { events.len() };
    };
    let is_before = |event: &Event| u32::from((event.t().wrapping_sub(anchor as u32) as i32) < reach);
    events.iter().map(is_before).sum::<u32>() as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use lobula_core::chain::Spec;
    use lobula_core::simulation::{Camera, Scene, SceneSpec};
    use lobula_core::wire::evt3;
    use lobula_core::{Encode, Span};

    const GEOMETRY: Geometry = Geometry::new(96, 64);

    /// Keeps packets, and refuses those whose number is in `refuse`.
    #[derive(Default)]
    struct Kept {
        packets: Vec<(PacketHeader, Vec<Event>)>,
        offered: u64,
        refuse: Vec<u64>,
    }

    impl Outlet for Kept {
        fn packet(&mut self, header: PacketHeader, events: &[Event]) -> bool {
            assert!(header.bytes.is_exact(), "{:?}", header.bytes);
            assert!(header.events.is_exact(), "{:?}", header.events);
            assert_eq!(header.count as usize, events.len());
            self.offered += 1;
            let accepted = !self.refuse.contains(&(self.offered - 1));
            if accepted {
                self.packets.push((header, events.to_vec()));
            }
            accepted
        }
    }

    impl Kept {
        fn events(&self) -> Vec<(u64, u16, u16, bool)> {
            let full = |header: &PacketHeader, e: &Event| {
                (full_time(header.t_first, e.t()), e.x(), e.y(), e.is_on())
            };
            self.packets.iter().flat_map(|(header, events)| events.iter().map(|e| full(header, e))).collect()
        }
    }

    fn pipeline(spec: &str) -> Pipeline {
        let spec: Spec = serde_json::from_str(spec).unwrap();
        let identity = Identity { camera: 0, generation: 7, flags: Flags::default(), packet_us: 1000 };
        Pipeline::new(Encoding::Evt3, Chain::try_new(&spec, GEOMETRY).unwrap(), identity)
    }

    /// 20 ms of a busy scene, as the camera's bytes.
    fn bytes() -> Vec<u8> {
        let spec = SceneSpec { geometry: GEOMETRY, rate_evs: 10_000_000, ..SceneSpec::default() };
        let mut camera = Camera::new(&Scene::try_new(&spec).unwrap()).with_packet_us(20_000);
        let mut bytes = vec![0; 4 << 20];
        let packet = camera.next_packet(&mut bytes);
        assert!(packet.complete);
        bytes.truncate(packet.bytes);
        bytes
    }

    fn arrival(bytes: &[u8]) -> Arrival<'_> {
        Arrival { bytes, ..Arrival::default() }
    }

    const DENOISE: &str = r#"[{ "kind": "refractory", "dt_us": 500 }]"#;

    #[test]
    fn packets_and_ledgers_do_not_depend_on_how_bytes_come() {
        let bytes = bytes();
        let mut whole = Kept::default();
        let mut one = pipeline(DENOISE);
        one.feed(arrival(&bytes), &mut whole);
        one.finish(&mut whole);
        assert!(one.events().filtered > 0 && one.events().published > 10_000);
        for piece in [1, 7, 1000, 4096] {
            let mut kept = Kept::default();
            let mut many = pipeline(DENOISE);
            for part in bytes.chunks(piece) {
                many.feed(arrival(part), &mut kept);
            }
            many.finish(&mut kept);
            assert_eq!(kept.events(), whole.events(), "in pieces of {piece}");
            assert_eq!((many.bytes(), many.events()), (one.bytes(), one.events()));
        }
        let total: u64 = whole.packets.iter().map(|(_, events)| events.len() as u64).sum();
        assert_eq!(total, one.events().published);
        let (last, rest) = whole.packets.split_last().unwrap();
        assert!(last.0.flags().contains(Flags::END) && last.1.is_empty());
        let mut before = 0;
        for (i, (header, events)) in rest.iter().enumerate() {
            assert_eq!((header.sequence, header.published_before), (i as u64, before));
            before += events.len() as u64;
            assert!(header.t_last - header.t_first < 1000, "{header:?}");
        }
    }

    #[test]
    fn what_shared_memory_refuses_is_counted_and_flagged() {
        let mut kept = Kept { refuse: vec![2, 3], ..Kept::default() };
        let mut pipeline = pipeline("[]");
        pipeline.feed(arrival(&bytes()), &mut kept);
        pipeline.finish(&mut kept);
        let ledger = pipeline.events();
        assert!(ledger.no_memory > 0);
        assert_eq!(
            ledger.published,
            kept.packets.iter().map(|(header, _)| u64::from(header.count)).sum::<u64>()
        );
        let gaps: Vec<_> =
            kept.packets.iter().map(|(header, _)| header.flags().contains(Flags::GAP)).collect();
        assert_eq!(gaps.iter().filter(|gap| **gap).count(), 1);
        assert!(gaps[2], "{gaps:?}");
    }

    #[test]
    fn lost_bytes_are_in_the_ledger_and_the_next_packet_says_so() {
        let bytes = bytes();
        let (mut kept, mut pipeline) = (Kept::default(), pipeline("[]"));
        pipeline.feed(arrival(&bytes[..5001]), &mut kept);
        pipeline.feed(Arrival { lost: 2000, ..arrival(&bytes[7001..]) }, &mut kept);
        pipeline.finish(&mut kept);
        assert_eq!((pipeline.bytes().lost, pipeline.bytes().input), (2000, bytes.len() as u64));
        assert!(kept.packets.iter().any(|(header, _)| header.flags().contains(Flags::GAP | Flags::OVERLOAD)));
    }

    /// The bytes of an event at each 100 µs from `t_first` on.
    fn bytes_of(t_first: u32, count: u32) -> Vec<u8> {
        let events: Vec<_> =
            (0..count).map(|i| Event::new(t_first + i * 100, 3, 4, lobula_core::Polarity::On)).collect();
        let t_last = (t_first + (count - 1) * 100).into();
        let span = Span { t_first: t_first.into(), t_last, geometry: GEOMETRY, events: &events };
        let mut bytes = vec![0; 4096];
        let mut encoder = evt3::Encoder::new();
        let encoded = encoder.encode(span, &mut bytes);
        let len = encoded.bytes + encoder.finish(&mut bytes[encoded.bytes..]);
        bytes.truncate(len);
        bytes
    }

    #[test]
    fn bytes_without_events_are_no_step_of_the_clock() {
        let (mut kept, mut pipeline) = (Kept::default(), pipeline("[]"));
        let bytes = bytes_of(1 << 23, 100);
        // The packet before: 20 minutes later by the sensor's clock.
        let restart = Restart { near_us: 1 << 23, shift_us: 1_200_000_000 };
        pipeline.feed(Arrival { restart: Some(restart), ..arrival(&bytes) }, &mut kept);
        let time_low = (0x6000u16 | ((1u32 << 23) + 9_950) as u16 & 0xfff).to_le_bytes();
        pipeline.feed(arrival(&time_low), &mut kept);
        pipeline.finish(&mut kept);
        assert_eq!(kept.events().len(), 100);
        assert!(kept.packets.iter().all(|(header, _)| !header.flags().contains(Flags::CLOCK_STEP)));
    }

    #[test]
    fn a_clock_that_steps_back_ends_the_packet_and_says_so() {
        let (mut kept, mut pipeline) = (Kept::default(), pipeline("[]"));
        let bytes = bytes_of(1 << 23, 100);
        for shift_us in [1_200_000_000, 0] {
            let restart = Restart { near_us: 1 << 23, shift_us };
            pipeline.feed(Arrival { restart: Some(restart), ..arrival(&bytes) }, &mut kept);
        }
        pipeline.finish(&mut kept);
        assert_eq!(kept.events().len(), 200);
        let steps = kept.packets.iter().filter(|(header, _)| header.flags().contains(Flags::CLOCK_STEP));
        assert_eq!(steps.map(|(header, _)| header.t_first).collect::<Vec<_>>(), [1 << 23]);
    }

    #[test]
    fn late_events_are_counted_like_full_times() {
        let anchor = (1u64 << 33) - 5;
        let times = [0, 3, 5, 9, u64::from(u32::MAX >> 1), 1].map(|after| anchor + after);
        let events = times.map(|t| Event::new(t as u32, 0, 0, lobula_core::Polarity::On));
        for t in [0, anchor - 1, anchor, anchor + 4, anchor + 5, anchor + 6, 1 << 34, u64::MAX] {
            let expected = times.iter().filter(|time| **time < t).count();
            assert_eq!(count_before(&events, anchor, t), expected, "before {t}");
        }
    }

    #[test]
    fn a_recording_that_starts_over_goes_on_in_time() {
        let bytes = bytes_of(5_000_000, 100);
        let (mut kept, mut pipeline) = (Kept::default(), pipeline("[]"));
        pipeline.feed(arrival(&bytes), &mut kept);
        let restart = Restart { near_us: 5_000_000, shift_us: 20_000 };
        pipeline.feed(Arrival { restart: Some(restart), ..arrival(&bytes) }, &mut kept);
        pipeline.finish(&mut kept);
        let times: Vec<_> = kept.events().iter().map(|event| event.0).collect();
        let turn = |shift: u64| (0..100).map(move |i| 5_000_000 + shift + i * 100);
        assert_eq!(times, turn(0).chain(turn(20_000)).collect::<Vec<_>>());
    }

    #[test]
    fn a_heartbeat_is_an_empty_packet() {
        let (mut kept, mut pipeline) = (Kept::default(), pipeline("[]"));
        pipeline.heartbeat(&mut kept);
        pipeline.feed(arrival(&bytes()[..3000]), &mut kept);
        pipeline.heartbeat(&mut kept);
        let counts: Vec<_> = kept.packets.iter().map(|(header, _)| header.count > 0).collect();
        assert_eq!((counts.first(), counts.last()), (Some(&false), Some(&false)));
        assert!(counts.contains(&true));
    }
}
