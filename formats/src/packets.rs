//! Files that are packets with a head each: the walk over them, the cursor and the side streams, once for all such
//! formats.
//!
//! A packet that does not unpack is skipped; where no packet begins that should, the next one is looked for. Both are
//! counted as damage, and all that comes after is read. Of a packet that the end of the file cuts, what is whole is
//! read.

use crate::byte_cursor::Bad;
use crate::container::{Cursor, Piece, Stop};
use crate::info::invalid_sentence;
use crate::input::Input;
use crate::intake::{Intake, Taken};
use crate::{Error, ErrorKind, Frame, ImuSample};
use lobula_core::{Counters, Fault, Sink};
use std::collections::BTreeSet;
use std::fmt::Debug;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// What a format of packets owes.
pub(crate) trait Packets: Debug + Send + Sync + 'static {
    /// Bytes of a packet's start that tell whether it is one; at most [`START_BYTES_MAX`].
    const START_BYTES: usize;

    /// Memory to unpack into.
    type Unpacker: Unpacked;

    fn input(&self) -> &Arc<Input>;

    /// Where in the file the packets are.
    fn range(&self) -> Range<u64>;

    /// Longest packet, unpacked, in bytes.
    fn bytes_max(&self) -> usize;

    /// Where damage to side streams is told.
    fn side_damage(&self) -> &SideDamage;

    /// What begins with these bytes; `None` where no packet of this file does, or too few are there to tell.
    fn head(&self, start: &[u8]) -> Option<Head>;

    /// Unpacks a body; of one that is `cut`, what is whole. The length in the unpacker, or `None` if the body itself
    /// is what it holds.
    fn unpack(
        &self,
        body: &[u8],
        cut: bool,
        unpacker: &mut Self::Unpacker,
    ) -> Result<Option<usize>, Unpacking>;

    /// Finds the elements in an unpacked body; `None` where it contradicts itself.
    fn elements(&self, head: &Head, cut: bool, bytes: &[u8]) -> Option<Elements>;

    /// Takes events or triggers from `elements.next` on, until they end or the sink is full.
    fn take(
        &self,
        head: &Head,
        bytes: &[u8],
        elements: &mut Elements,
        intake: &mut Intake,
        sink: &mut Sink<'_>,
    ) -> Result<(), Bad>;

    /// The sample of the inertial sensor at `elements.next`.
    fn imu(&self, bytes: &[u8], elements: &Elements, intake: &Intake) -> Result<SideItem<ImuSample>, Bad>;

    /// The frame at `elements.next`.
    fn frame(&self, bytes: &[u8], elements: &Elements, intake: &Intake) -> Result<SideItem<Frame>, Bad>;
}

/// What an element of a side stream is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum SideItem<T> {
    Item(T),
    /// Marked as invalid by the file.
    Invalid,
    /// Contradictory.
    Damaged,
}

/// Most bytes that tell whether a packet begins.
pub(crate) const START_BYTES_MAX: usize = 64;

/// Memory with an unpacked body.
pub(crate) trait Unpacked: Debug + Default + Send + Sync {
    fn bytes(&self, len: usize) -> &[u8];
}

/// Bodies that are not packed.
impl Unpacked for () {
    fn bytes(&self, _: usize) -> &[u8] {
        &[]
    }
}

/// Why a body does not unpack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unpacking {
    /// It contradicts its format.
    Damaged,
    /// It would be longer than the limit.
    TooLarge,
}

/// What a packet's head says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Head {
    pub kind: Kind,
    /// Bytes of the head.
    pub bytes: u64,
    /// Bytes after it.
    pub body_bytes: u64,
    /// What is added to the times of the elements, in µs, and how many bytes each takes, where the head tells.
    pub base_us: i64,
    pub element_bytes: usize,
}

/// What a packet holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Events,
    Triggers {
        channel: u8,
    },
    Imu,
    Frames,
    /// What is not read, or belongs to another camera.
    Other,
}

/// Elements of a packet in its unpacked body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Elements {
    /// Where they begin.
    pub first: usize,
    pub count: usize,
    /// The first that is not taken yet.
    pub next: usize,
    /// As in the head.
    pub base_us: i64,
    pub element_bytes: usize,
}

/// A packet in the file.
#[derive(Clone, Copy, Debug)]
struct Packet {
    head: Head,
    start: u64,
    /// Its end, or that of the packets where it is cut.
    end: u64,
    cut: bool,
}

impl Packet {
    fn bytes(&self) -> u64 {
        self.end - self.start
    }
}

/// One packet after the other.
#[derive(Debug)]
struct Walk<P> {
    packets: Arc<P>,
    next: u64,
    /// Where another goes on, in a recording that is read in pieces; else beyond everything.
    stop: u64,
}

impl<P> Clone for Walk<P> {
    fn clone(&self) -> Self {
        Self { packets: self.packets.clone(), next: self.next, stop: self.stop }
    }
}

impl<P: Packets> Walk<P> {
    fn new(packets: Arc<P>) -> Self {
        Self { next: packets.range().start, packets, stop: u64::MAX }
    }

    fn next(&mut self, counters: &mut Counters) -> Result<Option<Packet>, Error> {
        let end = self.packets.range().end;
        loop {
            let start = self.next;
            if start >= self.stop {
                return Ok(None);
            }
            if start >= end {
                // What comes after the packets.
                let len = self.packets.input().len().max(start);
                counters.bytes_decoded += len - start;
                self.next = len;
                return Ok(None);
            }
            let mut bytes = [0; START_BYTES_MAX];
            let room = usize::try_from(end - start).unwrap_or(usize::MAX).min(P::START_BYTES);
            let bytes = bytes.get_mut(..room).unwrap_or_default();
            self.packets.input().read_at(start, bytes)?;
            let found = self.packets.head(bytes).map(|head| Packet {
                head,
                start,
                end: end.min(start.saturating_add(head.bytes + head.body_bytes)),
                cut: start.saturating_add(head.bytes + head.body_bytes) > end,
            });
            match found {
                Some(packet) if !packet.cut => {
                    self.next = packet.end;
                    return Ok(Some(packet));
                }
                // Too long for the file: its length is wrong if there is another after it, else it is cut.
                Some(packet) => match self.look_for_next(start + 1)? {
                    Some(other) => self.skip(other, Fault::Damaged, counters),
                    None => {
                        self.next = packet.end;
                        return Ok(Some(packet));
                    }
                },
                None if room < P::START_BYTES => self.skip(end, Fault::CutShort, counters),
                None => {
                    let other = self.look_for_next(start + 1)?.unwrap_or(end);
                    self.skip(other, Fault::Damaged, counters);
                }
            }
        }
    }

    fn skip(&mut self, to: u64, fault: Fault, counters: &mut Counters) {
        counters.faults.count(fault);
        counters.bytes_faulty += to - self.next;
        self.next = to;
    }

    /// The next offset at which a packet begins.
    fn look_for_next(&self, from: u64) -> Result<Option<u64>, Error> {
        const READ_BYTES: usize = 64 << 10;
        let end = self.packets.range().end;
        let left = usize::try_from(end.saturating_sub(from)).unwrap_or(usize::MAX);
        let mut buffer = vec![0; READ_BYTES.min(left)];
        let mut at = from;
        while at < end {
            let room = usize::try_from(end - at).unwrap_or(usize::MAX).min(READ_BYTES);
            let bytes = buffer.get_mut(..room).unwrap_or_default();
            self.packets.input().read_at(at, bytes)?;
            let mut starts = bytes.windows(P::START_BYTES);
            if let Some(place) = starts.position(|start| self.packets.head(start).is_some()) {
                return Ok(Some(at + place as u64));
            }
            // The windows that the next read begins with were not seen yet.
            at += (room.saturating_sub(P::START_BYTES) + 1) as u64;
            if room < READ_BYTES {
                break;
            }
        }
        Ok(None)
    }
}

/// A body in memory, unpacked.
#[derive(Debug)]
struct Body<P: Packets> {
    packed: Vec<u8>,
    unpacker: P::Unpacker,
    /// How long it is in the unpacker; `None` if `packed` is it.
    unpacked: Option<usize>,
    /// Which packet it is of.
    start: Option<u64>,
}

impl<P: Packets> Default for Body<P> {
    fn default() -> Self {
        Self { packed: Vec::new(), unpacker: P::Unpacker::default(), unpacked: None, start: None }
    }
}

impl<P: Packets> Body<P> {
    fn bytes(&self) -> &[u8] {
        match self.unpacked {
            Some(len) => self.unpacker.bytes(len),
            None => &self.packed,
        }
    }

    /// Reads and unpacks the packet's body; false where it is damaged.
    fn load(&mut self, packets: &P, packet: &Packet) -> Result<bool, Error> {
        if self.start == Some(packet.start) {
            return Ok(true);
        }
        let from = packet.end.min(packet.start + packet.head.bytes);
        let Some(len) = usize::try_from(packet.end - from).ok().filter(|len| *len <= packets.bytes_max())
        else {
            return Err(too_large(packets, packet));
        };
        self.start = None;
        self.packed.resize(len, 0);
        packets.input().read_at(from, &mut self.packed)?;
        match packets.unpack(&self.packed, packet.cut, &mut self.unpacker) {
            Ok(unpacked) => (self.unpacked, self.start) = (unpacked, Some(packet.start)),
            Err(Unpacking::Damaged) => return Ok(false),
            Err(Unpacking::TooLarge) => return Err(too_large(packets, packet)),
        }
        Ok(true)
    }
}

fn too_large<P: Packets>(packets: &P, packet: &Packet) -> Error {
    let what = format!("has a packet of more than {} bytes", packets.bytes_max());
    let remedy = "it is damaged there, or raise Limits::chunk_bytes_max";
    Error::new(ErrorKind::TooLarge, packets.input().path(), what, remedy).at(packet.start)
}

/// A packet whose elements are being taken.
#[derive(Clone, Copy, Debug)]
struct Current {
    packet: Packet,
    elements: Elements,
}

/// What the walk came to next.
enum Found {
    /// A packet of a wanted kind.
    Packet(Current),
    /// One that is not wanted.
    Other(Packet),
    /// One of a wanted kind, of which nothing can be read.
    Unreadable(Packet),
    /// There is no more.
    End,
}

fn advance<P: Packets>(
    walk: &mut Walk<P>,
    body: &mut Body<P>,
    wanted: fn(Kind) -> bool,
    counters: &mut Counters,
) -> Result<Found, Error> {
    let Some(packet) = walk.next(counters)? else { return Ok(Found::End) };
    if !wanted(packet.head.kind) {
        return Ok(Found::Other(packet));
    }
    let whole = body.load(&walk.packets, &packet)?;
    let elements = whole.then(|| walk.packets.elements(&packet.head, packet.cut, body.bytes())).flatten();
    Ok(match elements {
        Some(elements) => Found::Packet(Current { packet, elements }),
        None => Found::Unreadable(packet),
    })
}

impl Packet {
    /// Counts its bytes.
    fn count(&self, readable: bool, counters: &mut Counters) {
        let fault = match (self.cut, readable) {
            (true, _) => Fault::CutShort,
            (false, false) => Fault::Damaged,
            (false, true) => {
                counters.bytes_decoded += self.bytes();
                return;
            }
        };
        counters.faults.count(fault);
        counters.bytes_faulty += self.bytes();
    }
}

fn error<P: Packets>(packets: &P, packet: &Packet, bad: Bad) -> Error {
    Error::new(bad.kind, packets.input().path(), bad.what, bad.remedy).at(packet.start)
}

/// The cursor over events and triggers.
#[derive(Debug)]
pub(crate) struct PacketCursor<P: Packets> {
    walk: Walk<P>,
    intake: Intake,
    current: Option<Current>,
    body: Body<P>,
}

impl<P: Packets> PacketCursor<P> {
    pub fn new(packets: Arc<P>, intake: Intake) -> Self {
        Self::over(Walk::new(packets), intake)
    }

    fn over(walk: Walk<P>, intake: Intake) -> Self {
        Self { walk, intake, current: None, body: Body::default() }
    }

    /// About `n` cursors over a stretch of packets each, which together are the whole.
    pub fn pieces(packets: &Arc<P>, intake: &Intake, n: usize) -> Result<Vec<Piece>, Error> {
        let range = packets.range();
        let stride = (range.end - range.start) / n.max(1) as u64;
        let mut starts = vec![range.start];
        let mut walk = Walk::new(packets.clone());
        // What is damaged is found again, and counted then.
        while let Some(packet) = walk.next(&mut Counters::new())? {
            if packet.start >= range.start + (stride * starts.len() as u64).max(1) {
                starts.push(packet.start);
            }
        }
        let stops: Vec<_> = starts.iter().copied().skip(1).chain([u64::MAX]).collect();
        let piece = |(next, stop)| {
            let walk = Walk { packets: packets.clone(), next, stop };
            Piece { cursor: Box::new(Self::over(walk, intake.clone())), wrap_us: 0 }
        };
        Ok(starts.into_iter().zip(stops).map(piece).collect())
    }
}

fn is_of_events(kind: Kind) -> bool {
    matches!(kind, Kind::Events | Kind::Triggers { .. })
}

impl<P: Packets> Cursor for PacketCursor<P> {
    fn fill(&mut self, sink: &mut Sink<'_>) -> Result<Stop, Error> {
        loop {
            let Some(Current { packet, elements }) = &mut self.current else {
                let counters = &mut self.intake.counters;
                match advance(&mut self.walk, &mut self.body, is_of_events, counters)? {
                    Found::Packet(current) => {
                        current.packet.count(true, counters);
                        self.current = Some(current);
                    }
                    Found::Other(packet) => packet.count(true, counters),
                    Found::Unreadable(packet) => packet.count(false, counters),
                    Found::End => return Ok(Stop::End),
                }
                continue;
            };
            let packets = &*self.walk.packets;
            // After a fork the body is to be read again.
            if !self.body.load(packets, packet)? {
                return Err(changed(packets, packet));
            }
            let taken = packets.take(&packet.head, self.body.bytes(), elements, &mut self.intake, sink);
            taken.map_err(|bad| error(packets, packet, bad))?;
            if elements.next < elements.count {
                return Ok(Stop::Full);
            }
            self.current = None;
        }
    }

    /// Inside a packet in proportion to the elements taken.
    fn position(&self) -> u64 {
        let Some(Current { packet, elements }) = &self.current else { return self.walk.next };
        let part = u128::from(packet.bytes()) * elements.next as u128 / (elements.count as u128).max(1);
        packet.start + u64::try_from(part).unwrap_or(packet.bytes())
    }

    fn counters(&self) -> Counters {
        self.intake.counters
    }

    fn fork(&self) -> Box<dyn Cursor> {
        let (walk, intake) = (self.walk.clone(), self.intake.clone());
        Box::new(Self { walk, intake, current: self.current, body: Body::default() })
    }
}

fn changed<P: Packets>(packets: &P, packet: &Packet) -> Error {
    let remedy = "let the other program finish, then open it again";
    Error::new(ErrorKind::Changed, packets.input().path(), "was changed while it was read", remedy)
        .at(packet.start)
}

/// What of the side streams was left out. The cursor does not look into their packets, so that they are in no other
/// count.
#[derive(Debug, Default)]
pub(crate) struct SideDamage {
    /// Starts of damaged packets.
    damaged: Mutex<BTreeSet<u64>>,
    /// Items marked as invalid: the most that any pass saw, so that two say it once.
    invalid_samples: AtomicU64,
    invalid_frames: AtomicU64,
}

impl SideDamage {
    /// Most packets that are told apart.
    const PACKETS_MAX: usize = 1000;

    fn add(&self, start: u64) {
        let mut starts = self.damaged.lock().unwrap_or_else(PoisonError::into_inner);
        if starts.len() < Self::PACKETS_MAX {
            starts.insert(start);
        }
    }

    /// Warnings.
    pub fn sentences(&self) -> Vec<String> {
        let invalid =
            [(&self.invalid_samples, "samples of the inertial sensor"), (&self.invalid_frames, "frames")];
        let invalid = invalid.map(|(count, what)| invalid_sentence(count.load(Ordering::Relaxed), what));
        self.damaged_sentence().into_iter().chain(invalid.into_iter().flatten()).collect()
    }

    fn damaged_sentence(&self) -> Option<String> {
        let starts = self.damaged.lock().unwrap_or_else(PoisonError::into_inner);
        let (first, count) = (starts.first()?, starts.len());
        Some(format!(
            "{count} packets of frames or of the inertial sensor are damaged and left out, from byte {first} on"
        ))
    }
}

/// A side stream: items of one kind, in file order.
#[derive(Debug)]
pub(crate) struct SideStream<P: Packets, T> {
    walk: Walk<P>,
    intake: Intake,
    current: Option<Current>,
    body: Body<P>,
    wanted: fn(Kind) -> bool,
    read: Read<P, T>,
    /// Items marked as invalid so far, and where they are told.
    invalid: u64,
    told: fn(&SideDamage) -> &AtomicU64,
    failed: bool,
}

type Read<P, T> = fn(&P, &[u8], &Elements, &Intake) -> Result<SideItem<T>, Bad>;

impl<P: Packets, T> SideStream<P, T> {
    fn new(
        packets: Arc<P>,
        intake: Intake,
        wanted: fn(Kind) -> bool,
        read: Read<P, T>,
        told: fn(&SideDamage) -> &AtomicU64,
    ) -> Self {
        let (walk, body) = (Walk::new(packets), Body::default());
        Self { walk, intake, current: None, body, wanted, read, invalid: 0, told, failed: false }
    }

    /// An item, or none at this step, or none any more.
    fn step(&mut self) -> Result<Option<Option<T>>, Error> {
        let Some(Current { packet, elements }) = &mut self.current else {
            match advance(&mut self.walk, &mut self.body, self.wanted, &mut Counters::new())? {
                Found::Packet(current) => self.current = Some(current),
                Found::Other(_) => {}
                Found::Unreadable(packet) => self.walk.packets.side_damage().add(packet.start),
                Found::End => return Ok(None),
            }
            return Ok(Some(None));
        };
        if elements.next >= elements.count {
            self.current = None;
            return Ok(Some(None));
        }
        let packets = &*self.walk.packets;
        let read = (self.read)(packets, self.body.bytes(), elements, &self.intake);
        let item = read.map_err(|bad| error(packets, packet, bad))?;
        elements.next += 1;
        Ok(Some(match item {
            SideItem::Item(item) => Some(item),
            SideItem::Invalid => {
                self.invalid += 1;
                (self.told)(packets.side_damage()).fetch_max(self.invalid, Ordering::Relaxed);
                None
            }
            SideItem::Damaged => {
                packets.side_damage().add(packet.start);
                None
            }
        }))
    }
}

impl<P: Packets> SideStream<P, ImuSample> {
    /// Samples of the inertial sensor.
    pub fn imu(packets: Arc<P>, intake: Intake) -> Self {
        Self::new(packets, intake, |kind| kind == Kind::Imu, P::imu, |told| &told.invalid_samples)
    }
}

impl<P: Packets> SideStream<P, Frame> {
    pub fn frames(packets: Arc<P>, intake: Intake) -> Self {
        Self::new(packets, intake, |kind| kind == Kind::Frames, P::frame, |told| &told.invalid_frames)
    }
}

impl<P: Packets, T> Iterator for SideStream<P, T> {
    type Item = Result<T, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.failed {
            match self.step() {
                Ok(Some(Some(item))) => return Some(Ok(item)),
                Ok(Some(None)) => {}
                Ok(None) => return None,
                Err(error) => {
                    self.failed = true;
                    return Some(Err(error));
                }
            }
        }
        None
    }
}

/// Takes a trigger; its place is after the events so far.
pub(crate) fn take_trigger(
    intake: &mut Intake,
    sink: &mut Sink<'_>,
    t_us: i64,
    channel: u8,
    edge: lobula_core::Polarity,
) -> Result<Taken, Bad> {
    let ordinal = intake.counters.events - intake.counters.off_sensor;
    let t = intake.time(t_us)?;
    if !sink.push_trigger(lobula_core::Trigger { t, ordinal, channel, edge }) {
        return Ok(Taken::Full);
    }
    intake.counters.triggers += 1;
    Ok(Taken::Yes)
}
