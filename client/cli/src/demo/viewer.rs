//! The demo's own client: the picture, the rates, and the judgement of the filter by the scene's labels.

use super::picture::Picture;
use super::truth::Truth;
use crate::Failure;
use lobula_client::{Client, Error, EventLedger, EventSubscriber, Packet, PacketHeader, SubscribeOptions};
use lobula_core::simulation::{LabelCounts, Scene};
use std::time::{Duration, Instant};

/// The demo's own client.
#[derive(Debug)]
pub struct Viewer {
    client: Client,
    events: EventSubscriber,
    /// What the filter did to signal and noise.
    pub verdict: Verdict,
    /// In and out.
    pub rates: Rates,
    exposure: Exposure,
    /// The last picture taken.
    pub picture: Option<Picture>,
    /// Generations of the daemon seen so far.
    pub generations: u64,
    generation: u64,
}

impl Viewer {
    /// Subscribes; pictures show `exposure_us` of stream time.
    pub fn open(client: Client, exposure_us: u64) -> Result<Self, Failure> {
        let events = client.events(SubscribeOptions::default())?;
        Ok(Self {
            client,
            events,
            verdict: Verdict::default(),
            rates: Rates::default(),
            exposure: Exposure::new(exposure_us),
            picture: None,
            generations: 0,
            generation: 0,
        })
    }

    /// Looks at what comes until then. That the daemon is gone is no failure.
    pub fn pump(&mut self, truth: &Truth, until: Instant) -> Result<(), Failure> {
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(());
            }
            match self.events.recv(left) {
                Ok(packet) => self.look(truth, &packet)?,
                Err(Error::Timeout { .. } | Error::NoDaemon { .. }) => return Ok(()),
                Err(error) => return Err(error.into()),
            }
        }
    }

    fn look(&mut self, truth: &Truth, packet: &Packet) -> Result<(), Failure> {
        let header = packet.header();
        self.generations += u64::from(self.generation != header.generation);
        self.generation = header.generation;
        self.rates.take(header);
        if let Some(scene) = truth.scene() {
            self.verdict.take(scene, packet);
        }
        if let Some(picture) = self.exposure.take(truth, packet)? {
            self.picture = Some(picture);
        }
        Ok(())
    }

    /// Whether the daemon is there.
    pub fn is_connected(&self) -> bool {
        self.client.is_connected()
    }

    /// Asks the daemon to end.
    pub fn stop_daemon(&self) -> Result<(), Failure> {
        Ok(self.client.stop()?)
    }
}

/// Events a second over the last second or so.
#[derive(Debug, Default)]
pub struct Rates {
    mark: Option<(Instant, u64, EventLedger)>,
    /// Decoded.
    pub in_evs: f64,
    /// Published.
    pub out_evs: f64,
}

impl Rates {
    fn take(&mut self, header: &PacketHeader) {
        let now = (Instant::now(), header.generation, header.events);
        let Some((then, generation, events)) = self.mark.filter(|(_, generation, _)| *generation == now.1)
        else {
            self.mark = Some(now);
            return;
        };
        let seconds = now.0.duration_since(then).as_secs_f64();
        if seconds >= 0.5 {
            self.in_evs = (header.events.decoded - events.decoded) as f64 / seconds;
            self.out_evs = (header.events.published - events.published) as f64 / seconds;
            self.mark = Some((now.0, generation, header.events));
        }
    }
}

/// What the filter did to signal and noise, counted over the packets looked at.
///
/// The ledger in a packet's header tells how many events the camera had sent by then, and the scene what they were; so
/// the raw side needs no raw events.
#[derive(Debug, Default)]
pub struct Verdict {
    /// What went into the filter.
    pub raw: LabelCounts,
    /// What came out.
    pub kept: LabelCounts,
    /// Events that the camera never sent: there must be none.
    pub unknown: u64,
    /// Generation and events decoded at the end of the packet before.
    last: Option<(u64, u64)>,
    busy: Duration,
    since: Option<Instant>,
}

impl Verdict {
    /// Share of the signal that was kept, in percent.
    pub fn signal_kept(&self) -> f64 {
        100.0 * self.kept.signal() as f64 / (self.raw.signal() as f64).max(1.0)
    }

    /// Share of the noise that was removed, in percent.
    pub fn noise_removed(&self) -> f64 {
        100.0 - 100.0 * self.kept.noise() as f64 / (self.raw.noise() as f64).max(1.0)
    }

    fn take(&mut self, scene: &Scene, packet: &Packet) {
        let header = packet.header();
        let decoded = header.events.decoded;
        let before = self.last.replace((header.generation, decoded));
        let start = Instant::now();
        let before = before.filter(|(generation, _)| {
            *generation == header.generation && packet.lost_before() == 0 && header.bytes.lost == 0
        });
        let Some((_, before)) = before.filter(|_| self.has_time(start)) else { return };
        let raw = scene.counts_of_first(decoded).minus(&scene.counts_of_first(before));
        self.raw = self.raw.plus(&raw);
        for event in packet.iter() {
            match scene.label(packet.time(*event), *event) {
                Some(label) => self.kept.count(label),
                None => self.unknown += 1,
            }
        }
        self.busy += start.elapsed();
    }

    /// At high rates only some packets are judged, else this client would be the slow one.
    fn has_time(&mut self, now: Instant) -> bool {
        const SHARE: f64 = 0.25;
        let since = *self.since.get_or_insert(now);
        self.busy.as_secs_f64() <= 0.01 + SHARE * now.duration_since(since).as_secs_f64()
    }
}

/// Time between two pictures.
const PICTURE: Duration = Duration::from_millis(100);

/// Collects the events of a stretch of stream time.
#[derive(Debug)]
struct Exposure {
    length_us: u64,
    open: Option<Open>,
    due: Option<Instant>,
}

#[derive(Debug)]
struct Open {
    generation: u64,
    t0: u64,
    picture: Picture,
}

impl Exposure {
    fn new(length_us: u64) -> Self {
        Self { length_us, open: None, due: None }
    }

    /// Adds a packet; gives the picture whose time is over.
    fn take(&mut self, truth: &Truth, packet: &Packet) -> Result<Option<Picture>, Failure> {
        let header = packet.header();
        let broken = |open: &Open| open.generation != header.generation || packet.lost_before() > 0;
        if self.open.as_ref().is_some_and(broken) {
            self.open = None;
        }
        let now = Instant::now();
        let Some(open) = &mut self.open else {
            if self.due.is_none_or(|due| now >= due) {
                let picture = Picture::new(header.geometry());
                self.open = Some(Open { generation: header.generation, t0: header.t_last + 1, picture });
            }
            return Ok(None);
        };
        let stretch = open.t0..open.t0 + self.length_us;
        let inside = packet.iter().filter(|event| stretch.contains(&packet.time(**event)));
        inside.for_each(|event| open.picture.filtered.mark(*event));
        if header.t_last < stretch.end {
            return Ok(None);
        }
        truth.raw(stretch, |event| open.picture.raw.mark(event))?;
        self.due = Some(now + PICTURE);
        Ok(self.open.take().map(|open| open.picture))
    }
}
